"""Adaptation to one DIGIT: scores, references, a whole adaptation, resuming, refusals."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from ball_frames import BALL_MM, HELD_OUT, POSES
from safetensors.torch import load_file

from t2twin.adaptation import pipeline
from t2twin.adaptation.pipeline import adapt
from t2twin.adaptation.real_frame_evaluation import (
    INITIAL,
    TRAINED,
    AdaptationScores,
    References,
    choose,
    evaluate_frames,
    publish,
    simulate_references,
)
from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.core.records import read_json
from t2twin.sim.calibrate.calibrate import DEFAULT_TOLERANCE, RECORD, OpticsRecord
from t2twin.sim.dataset.store import read_info
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.layout import load_layout
from t2twin.sim.taxels.phi import Phi
from t2twin.translate.inference.estimate import Estimate
from t2twin.translate.runs.config import HOME
from t2twin.translate.training.train import train
from t2twin.translate.uncertainty.ood import OODClass

FULL_SCALE = 40_000.0
LAYOUT = load_layout("cyskin-20")


def run_of(counts, kinds=None) -> Any:
    """A run that predicts these counts for any frames."""
    phi = Phi(LAYOUT.x_mm, LAYOUT.y_mm)
    array = SimpleNamespace(
        x_mm=LAYOUT.x_mm, y_mm=LAYOUT.y_mm, full_scale_counts=FULL_SCALE, phi=phi
    )
    data = SimpleNamespace(array=array)
    kinds = kinds or [OODClass.IN_DISTRIBUTION] * len(counts)
    estimate = Estimate(FULL_SCALE, np.array(counts), ood_class=np.array(kinds, dtype=object))
    return SimpleNamespace(
        config=SimpleNamespace(data=data, has_uncertainty=False, predicts_contact=False),
        _classified_estimate=lambda *_, contact: estimate,
    )  # fmt: skip


def bump(x_mm, y_mm, most=9000.0):
    return most * np.exp(-((LAYOUT.x_mm - x_mm) ** 2 + (LAYOUT.y_mm - y_mm) ** 2) / (2 * 5.0**2))


def test_each_score_reacts_to_its_own_error():
    truth = bump(0.0, 0.0)
    counts = [1.2 * truth, bump(3.0, 0.0), bump(0.0, -16.0) + bump(0.0, 16.0), truth]
    kinds = [OODClass.IN_DISTRIBUTION] * 3 + [OODClass.OTHER]
    nothing = np.zeros((4, 2, 2))
    references = References(
        list("abcd"), nothing, np.full(4, 4.0), nothing, nothing, np.tile(truth, (4, 1)), nothing,
        nothing,
    )  # fmt: skip
    _, errors = evaluate_frames(run_of(counts, kinds), references.frames, references, None)
    harder, beside, apart, other = (row for _, row in errors.iterrows())
    assert harder.force_error == pytest.approx(0.2) and harder.regions == 1
    assert harder.rmse_percent == pytest.approx(20.0 * np.sqrt(np.mean(truth**2)) / FULL_SCALE)
    assert 1.5 < beside.centroid_mm < 4.0
    assert apart.regions == 2 and other.rmse_percent == 0.0
    scores = AdaptationScores.of(errors)
    assert (scores.single_region, scores.refused) == (3, 1)
    assert (scores.interval_coverage_percent, scores.depth_rmse_mm) == (None, None)
    squares = [row.rmse_percent**2 for row in (harder, beside, apart, other)]
    assert scores.rmse_percent == pytest.approx(np.sqrt(np.mean(squares)))


def test_the_reference_has_the_pose_found_in_the_frame():
    frames = np.zeros((2, 320, 240, 3), np.uint8)
    poses = np.array([[1.0, -0.5, 0.9], [-2.0, 1.0, 1.2]])
    found = simulate_references(["a", "b"], poses, frames, [BALL_MM, BALL_MM], SensorPair())
    assert 0.5 < found.force_n[0] < found.force_n[1] < 12.0
    assert found.simulated.shape == frames.shape and found.in_contact.any(axis=(1, 2)).all()
    for counts, pose in zip(found.counts, poses, strict=True):
        middle = [np.average(axis, weights=counts) for axis in (LAYOUT.x_mm, LAYOUT.y_mm)]
        np.testing.assert_allclose(middle, pose[:2], atol=2.0)


def scores_of(real, simulated, refused=0):
    return [AdaptationScores(rmse, 0.1, 7, 0.05, 90.0, None, refused) for rmse in (real, simulated)]


@pytest.mark.parametrize(
    ("real", "simulated", "refused", "kept"),
    [
        (0.7, 0.4, 1, TRAINED),
        (0.9, 0.4, 1, INITIAL),
        (0.7, 0.6, 1, INITIAL),
        (0.8, 0.5, 1, INITIAL),
        (0.7, 0.4, 2, INITIAL),
    ],
)
def test_the_more_accurate_run_is_published(tmp_path, real, simulated, refused, kept):
    folders = {name: tmp_path / name for name in (TRAINED, INITIAL)}
    for name, folder in folders.items():
        folder.mkdir()
        (folder / "best.safetensors").write_text(name)
        (folder / "README.md").write_text(f"# {name}\n\n## Limits\n")
    on_real, on_simulated = ({TRAINED: each} for each in scores_of(real, simulated, refused))
    assert choose(on_real, on_simulated) == TRAINED
    on_real[INITIAL], on_simulated[INITIAL] = scores_of(0.8, 0.5, 1)
    assert choose(on_real, on_simulated) == kept
    for _ in range(2):  # an interrupted adaptation publishes again
        publish(folders[kept], kept, on_real, on_simulated, tmp_path / "field")
    assert (tmp_path / "field" / "best.safetensors").read_text() == kept
    card = (tmp_path / "field" / "README.md").read_text()
    assert card.count(f"This is the {kept} run") == 1 and card.startswith(f"# {kept}")
    assert f"| trained | {real:.2f} | {simulated:.2f} |" in card and "| initial | 0.80 |" in card
    assert card.index("## Adaptation") < card.index("## Limits")


def briefly(model, data_dir, preset, out_dir, minutes, init_from, frame_check):
    """As many steps on every machine."""
    assert preset.drift > 0 and minutes == 0.5 and init_from == HOME / "field"
    return train(
        model, data_dir, replace(preset, batch=8), out_dir, epochs=1, init_from=init_from,
        frame_check=frame_check,
    )  # fmt: skip


def test_a_contact_in_the_background_is_named_before_the_first_step(unit, tmp_path, monkeypatch):
    def stop(*_):
        raise T2TwinError("stopped")

    monkeypatch.setattr(pipeline, "_fit", stop)
    touched = next(path for path in sorted(unit.glob("*.png")) if path.name != "background.png")
    for background, names_it in ((unit / "background.png", False), (touched, True)):
        said: list[str] = []
        with pytest.raises(T2TwinError, match="stopped"):
            adapt(background, unit, BALL_MM, tmp_path / background.stem, report=said.append)
        assert (f"warning: {background} shows a contact, by field" in said[0]) == names_it


@pytest.fixture(scope="module")
def adapted_run(unit, tmp_path_factory):
    """An adaptation on few shapes."""
    out = tmp_path_factory.mktemp("adapted") / "out"
    fit = pipeline.calibrate

    def calibrate(background, presses, ball_mm, held_out, camera, report, tolerance, sensor, _):
        assert (background, presses) == (unit / "background.png", unit)
        assert (ball_mm, held_out) == (BALL_MM, HELD_OUT)
        assert (camera, tolerance) == (sensor.camera, DEFAULT_TOLERANCE)
        return fit(background, presses, ball_mm, held_out)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "SHAPES_PER_MINUTE", 25)
        patch.setattr(pipeline, "calibrate", calibrate)
        patch.setattr(pipeline, "train", briefly)
        said: list[str] = []
        adapted = adapt(
            unit / "background.png", unit, BALL_MM, out, HELD_OUT, minutes=1.0, report=said.append
        )
    assert [line for line in said if "step" in line] == [
        f"{name}: step {number} of 4" for number, name in enumerate(pipeline.STEPS, start=1)
    ]
    return out, adapted


@pytest.mark.exhaustive
def test_an_adaptation_ends_with_a_run_evaluated_on_held_out_frames(adapted_run):
    out, adapted = adapted_run
    assert adapted.presses == HELD_OUT and list(adapted.minutes) == list(pipeline.STEPS)
    assert adapted.optics_psnr_db > 32
    # the frames are the twin's own, so that only the fitted light lies between both
    for name, real in adapted.real.items():
        apart = real.rmse_percent - adapted.simulated[name].rmse_percent
        assert abs(apart) < 0.2 * adapted.zero_rmse_percent
        coverage = real.interval_coverage_percent
        assert coverage is not None and 0.0 < coverage <= 100.0
    folders = {
        TRAINED: out / "averaged" / "field", INITIAL: HOME / "field", "own": out / "training/field",
    }  # fmt: skip
    weights = {name: load_file(folder / "best.safetensors") for name, folder in folders.items()}
    for name, tensor in weights[TRAINED].items():
        if name.startswith("encoder") and tensor.is_floating_point():
            initial, own = weights[INITIAL][name].float(), weights["own"][name].float()
            mean = torch.lerp(initial, own, pipeline.TRAINED_SHARE)
            torch.testing.assert_close(tensor.float(), mean, rtol=1e-5, atol=1e-6)
    kept = (out / "field" / "best.safetensors").read_bytes()
    assert kept == (folders[adapted.kept] / "best.safetensors").read_bytes()
    assert 0.0 < adapted.mean_array_rmse_percent < adapted.zero_rmse_percent < 15.0
    fitted = read_json(out / RECORD, OpticsRecord, "adapt")
    places = [(press.x_mm, press.y_mm) for press in fitted.held_out]
    np.testing.assert_allclose(places, POSES[-HELD_OUT:, :2], atol=0.15)
    info = read_info(out / "data")
    assert info.recipe is not None and info.recipe.light.frames == 1
    assert info.camera.noise_grey == pytest.approx(2.8)
    for name in ("optics_coverage.png", "ball.step", "recipe.toml", "adapted.json"):
        assert (out / name).exists(), name
    uncertainty = fitted.uncertainty
    assert uncertainty is not None and adapted.uncertainty == uncertainty
    for press, pose in zip(uncertainty.presses, POSES, strict=True):
        assert press.depth_mm.low < pose[2] < press.depth_mm.high
        assert press.force_n is not None and press.force_n.low < press.force_n.high
    page = (out / "index.html").read_text()
    assert "Uncertainty" in page and all(press.name in page for press in uncertainty.presses)
    assert page.count("data:image/png") == HELD_OUT
    assert f"{adapted.real[adapted.kept].rmse_percent:.2f} %" in page


@pytest.mark.exhaustive
def test_finished_steps_are_not_repeated(adapted_run, unit, monkeypatch):
    out, adapted = adapted_run
    before = (out / "field" / "best.safetensors").read_bytes()
    monkeypatch.setattr(pipeline, "calibrate", None)
    monkeypatch.setattr(pipeline, "train", briefly)
    said: list[str] = []
    again = adapt(
        unit / "background.png", unit, BALL_MM, out, HELD_OUT, minutes=1.0, report=said.append
    )
    assert replace(again, minutes={}) == replace(adapted, minutes={})
    assert (out / "field" / "best.safetensors").read_bytes() == before


def refused(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(["adapt", *(str(argument) for argument in arguments)])
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


@pytest.mark.exhaustive
def test_invalid_arguments_are_refused(adapted_run, unit, tmp_path, capsys):
    out, _ = adapted_run
    given = ("--background", unit / "background.png", "--presses", unit)
    other = ("--ball-diameter-mm", 5.0, "--held-out", HELD_OUT, "--out", out)
    assert "other frames or numbers" in refused(capsys, *given, *other)
    (tmp_path / "mine.txt").write_text("mine")
    ball = ("--ball-diameter-mm", BALL_MM)
    assert "contains no adaptation" in refused(capsys, *given, *ball, "--out", tmp_path)
    fresh = tmp_path / "fresh"
    assert "from 1 to 6000" in refused(capsys, *given, *ball, "--out", fresh, "--minutes", 0.1)
    assert "there is no run" in refused(capsys, *given, *ball, "--out", fresh, "--init-from", "x")
    wrong = ("--init-from", HOME / "field", "--model", "resnet18")
    assert "is a field run" in refused(capsys, *given, *ball, "--out", fresh, *wrong)
    assert not fresh.exists()
