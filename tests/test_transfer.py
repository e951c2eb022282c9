"""The benchmark of models that are learned on true counts: their scores and examples."""

import numpy as np
import pytest

from benchmarks.networks import small_models, transfer_data
from benchmarks.networks.small_models import Errors, Labels, errors_of, share_kept
from benchmarks.networks.transfer import rows_of
from benchmarks.networks.transfer_data import (
    IMAGES,
    PREDICTED,
    SETS,
    SLIP_SHARE,
    TRUE,
    Examples,
    Pair,
    Task,
    make_readings,
    slip_examples,
    tasks_of,
)
from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.sim.dataset.columns import PATH
from t2twin.sim.dataset.store import lists, read_split
from t2twin.translate.inference.load import load_run

pytestmark = pytest.mark.usefixtures("one_thread")

PICTURES = ["source_image", "source_background"]

SHAPES = np.repeat(["a", "b", "c", "d"], 100)


@pytest.fixture(autouse=True)
def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trainings that are long enough for simple tasks."""
    monkeypatch.setattr(small_models, "STEPS", 200)


def spread(seed: int) -> np.ndarray:
    """Inputs, (400, 3)."""
    return np.random.default_rng(seed).standard_normal((SHAPES.size, 3)).astype(np.float32)


def test_scores_follow_from_the_errors() -> None:
    true = Labels(np.array([[1.0, 0.0], [-1.0, 0.0], [3.0, 4.0], [-3.0, -4.0]]))
    names = np.array(["a", "a", "b", "b"])
    for factor, score in ((1.0, 1.0), (0.5, 0.5), (0.0, 0.0), (-1.0, -1.0)):
        found = errors_of(factor * true.values[None], true, true).score(names)
        assert found["score"] == pytest.approx(score)
        assert found["error"] == pytest.approx(abs(1.0 - factor) * np.sqrt(13.0))


def test_classes_have_equal_weight_and_a_guess_scores_zero() -> None:
    true = Labels(np.array([0] * 90 + [1] * 10), classes=2)
    names = np.array(["a", "b"] * 50)
    for answers, score in (
        (true.values, 1.0),
        (np.zeros(100, int), 0.0),
        (1 - true.values, -1.0),
        (np.array([0] * 90 + [0, 1] * 5), 0.5),
    ):
        found = errors_of(answers[None], true, true).score(names)
        assert found["score"] == pytest.approx(score)
        assert found["error"] == pytest.approx(50.0 * (1.0 - score))
    only = Labels(np.zeros(100, int), classes=2)
    with pytest.raises(T2TwinError, match="1 of 2 classes occur"):
        errors_of(only.values[None], only, true)


def test_the_share_kept_is_paired_over_shapes() -> None:
    whole = np.repeat([0.1, 0.2, 0.3, 0.4], 100)
    full, kept, useless = (
        Errors(own, np.ones(400), np.ones(400), is_squared=False)
        for own in (whole, 0.5 + whole / 2, np.full(400, 0.99))
    )
    found = share_kept(kept, full, SHAPES)
    assert found["percent"] == pytest.approx(50.0)
    assert found["interval"] is None or np.ptp(found["interval"]) < 1e-9
    assert share_kept(full, useless, SHAPES)["percent"] is None


def test_a_task_is_learned_on_true_counts_and_fed_with_predicted_ones() -> None:
    """A linear task: predicted inputs of half the size keep half of the score."""
    examples = []
    for seed in (0, 1):
        true = spread(seed)
        inputs = {TRUE: true, PREDICTED: 0.5 * true, IMAGES: np.zeros_like(true)}
        examples.append(Examples(inputs, Labels(true[:, :2] - true[:, 1:]), SHAPES))
    row = rows_of(Task(examples[0], {"place": {"val": examples[1]}}))["place"]["val"]
    assert row["examples"] == SHAPES.size
    assert row["true"]["score"] > 0.9
    assert row["predicted"]["score"] == pytest.approx(0.5, abs=0.05)
    assert row["kept"]["percent"] == pytest.approx(
        100.0 * row["predicted"]["score"] / row["true"]["score"]
    )
    assert row["images"]["score"] == pytest.approx(0.0, abs=0.05)
    assert row["adapted"]["score"] > 0.9


def test_examples_of_slip_have_the_press_and_the_touch() -> None:
    table = {
        "shape": np.array(["a", "a", "a", "b", "b"]),
        "index": np.array([0, 1, 2, 0, 1]),
        PATH: np.array([0, 0, 2, 0, 0]),
        SLIP_SHARE: np.array([0.0, 0.5, 0.9, 0.0, 0.4]),
    }
    found = slip_examples(table, {TRUE: np.arange(5.0)[:, None]})
    np.testing.assert_array_equal(found.inputs[TRUE], [[0.0, 1.0], [3.0, 4.0]])
    assert found.labels.values.tolist() == [1, 0] and found.shapes.tolist() == ["a", "b"]


def test_tasks_follow_from_datasets_and_a_translator(moving_dataset, tmp_path, monkeypatch) -> None:
    """Finished datasets are used as they are."""
    monkeypatch.setattr(transfer_data, "SPLITS", ("train", "val"))
    pair = Pair("digit", "cyskin-20", "field", "small", random_shapes=3)
    for name in SETS:
        pair.data(tmp_path, name).parent.mkdir(parents=True, exist_ok=True)
        pair.data(tmp_path, name).symlink_to(moving_dataset)
    make_readings(pair, tmp_path)

    tests = {name: task for task in tasks_of(pair, tmp_path) for name in task.tests}
    assert set(tests) == {"family", "place", "place_in_view", "force", "slip"}
    force, slip = tests["force"].train, tests["slip"].train
    true, predicted = force.inputs[TRUE], force.inputs[PREDICTED]
    table = read_split(moving_dataset, "train", ["target_counts", "force_n", "index", PATH])
    np.testing.assert_allclose(40_000 * true, lists(table, "target_counts"), atol=0.01)
    np.testing.assert_array_equal(force.labels.values[:, 0], table["force_n"].to_numpy())
    run, pictures = load_run("field"), read_split(moving_dataset, "train", PICTURES)
    for row, both in enumerate(pictures.to_pylist()):
        image, frame = (decode_png(both[name]["bytes"]) for name in PICTURES)
        np.testing.assert_allclose(40_000 * predicted[row], run.predict(image, frame), atol=20.0)
    moves = table["index"].to_numpy() > table[PATH].to_numpy()
    np.testing.assert_array_equal(slip.inputs[TRUE][:, true.shape[1] :], true[moves])
    assert tests["place"].train.labels.values.shape == (len(true), 2)
