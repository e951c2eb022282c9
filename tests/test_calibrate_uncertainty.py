"""What a ball's frames leave open, and what settles it: twins of known scale, balls and modulus."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from ball_frames import POSES, save, small_digit
from msgspec import structs

from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.sim.calibrate.calibrate import (
    FORCES,
    Tolerance,
    ball_forces_n,
    calibrate,
    force_ratio,
    read_measurements,
)
from t2twin.sim.calibrate.fit import BallFit, Geometry, State, Terms
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.optical.illumination import Leds
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.optical.units import UnitRanges, sample_unit
from t2twin.sim.sensors.pair import SensorPair

DIGIT = SensorPair().camera
GEL = DIGIT.own_gel
SCALE, YOUNG_MPA = 18.0, 0.42
"""The twin's; stated are 19.2 px/mm and assumed 0.5 MPa."""
PRESSES = 7
TRUE_POSES = POSES[:PRESSES]
BALLS_MM = np.resize([4.0, 6.0], PRESSES)
OFF_MM = 0.05
"""How far off the balls' diameters are stated."""
NAMES = [f"press_{index:02d}.png" for index in range(PRESSES)]


def frames_of(sensor, scale_px_per_mm, folder):
    """The folder, with frames of a twin of the sensor."""
    optics = replace(
        sensor.optics, camera=structs.replace(sensor.optics.camera, scale_px_per_mm=scale_px_per_mm)
    )
    renderer = ImageRenderer(optics, GEL, sensor.spec.camera.noise_grey)
    rng = np.random.default_rng(5)
    still = renderer.render(ball_surface(GEL, 0, 0, 1.0) * 0, rng)
    save(still, folder / "background.png")
    for name, (x_mm, y_mm, depth_mm), ball_mm in zip(NAMES, TRUE_POSES, BALLS_MM, strict=True):
        surface = ball_surface(GEL, x_mm, y_mm, depth_mm, ball_mm / 2)
        save(renderer.render(surface, rng), folder / name)
    return folder


@pytest.fixture(scope="module")
def twin_frames(tmp_path_factory):
    return frames_of(DIGIT, SCALE, tmp_path_factory.mktemp("twin"))


@pytest.fixture(scope="module")
def true_forces_n():
    return ball_forces_n(DIGIT, TRUE_POSES, BALLS_MM) * YOUNG_MPA / GEL.young_mpa


def table(folder, *columns):
    """forces.csv of named columns, each (name, values), empty where a value is None."""
    lines = [",".join(["file", *(name for name, _ in columns)])]
    for index in range(PRESSES):
        cells = ["" if values[index] is None else f"{values[index]:.3f}" for _, values in columns]
        lines.append(",".join([NAMES[index], *cells]))
    (folder / FORCES).write_text("\n".join(lines) + "\n")


@pytest.fixture
def copied(twin_frames, tmp_path):
    return shutil.copytree(twin_frames, tmp_path / "frames")


@pytest.fixture(scope="module")
def stated(tmp_path_factory):
    """Fitted as one fits who knows no more than two balls' diameters, and these not quite."""
    sensor = small_digit()
    folder = frames_of(sensor, SCALE / 2, tmp_path_factory.mktemp("small"))
    table(folder, ("ball_diameter_mm", BALLS_MM + OFF_MM))
    with pytest.MonkeyPatch.context() as patch:
        # A force takes several presses, most of them to the last micrometer.
        patch.setattr("t2twin.sim.contact.contact_solver.DEPTH_TOLERANCE_MM", 0.02)
        patch.setattr("t2twin.sim.calibrate.fit.MAX_STEPS", 1)
        return calibrate(folder / "background.png", folder, 5.0, 1, sensor=sensor).uncertainty


@pytest.fixture(scope="module")
def anchored(twin_frames, true_forces_n, tmp_path_factory):
    """Fitted with three displacements and the forces of the others: the folder of the command."""
    folder = shutil.copytree(twin_frames, tmp_path_factory.mktemp("copy") / "frames")
    depths = [float(pose[2]) if index < 3 else None for index, pose in enumerate(TRUE_POSES)]
    forces = [None if index < 3 else force for index, force in enumerate(true_forces_n)]
    table(folder, ("force_n", forces), ("depth_mm", depths), ("ball_diameter_mm", BALLS_MM))
    out = folder / "out"
    main(["calibrate", "--background", str(folder / "background.png"), "--presses", str(folder),
          "--ball-diameter-mm", "5", "--held-out", "1", "--ball-tolerance-mm", "0.02",
          "--out", str(out)])  # fmt: skip
    return out


def test_the_truth_lies_within_the_stated_ranges(stated, true_forces_n):
    assert (stated.depth_measurements, stated.force_measurements, stated.young_mpa) == (0, 0, None)
    assert stated.scale_px_per_mm.low <= SCALE / 2 <= stated.scale_px_per_mm.high
    for press, pose, ball_mm, force_n in zip(
        stated.presses, TRUE_POSES, BALLS_MM, true_forces_n, strict=True
    ):
        assert press.ball_diameter_mm == pytest.approx(ball_mm + OFF_MM)
        assert press.depth_mm.low < pose[2] < press.depth_mm.high
        assert press.force_n.low < force_n < press.force_n.high
        assert press.depth_mm.low < press.depth_mm.value < press.depth_mm.high
        # with the square of the scale, and a little with the ball
        assert press.depth_mm.high / press.depth_mm.low == pytest.approx(
            (21.2 / 17.2) ** 2, rel=0.15
        )


@pytest.mark.exhaustive
def test_anchors_find_scale_and_modulus(anchored, true_forces_n):
    sure = json.loads((anchored / "optics.json").read_text())["uncertainty"]
    assert (sure["depth_measurements"], sure["force_measurements"]) == (3, PRESSES - 3)
    assert sure["scale_px_per_mm"]["value"] == pytest.approx(SCALE, rel=0.01)
    assert sure["young_mpa"]["value"] == pytest.approx(YOUNG_MPA, rel=0.04)
    for name, truth in (("scale_px_per_mm", SCALE), ("young_mpa", YOUNG_MPA)):
        assert sure[name]["low"] < truth < sure[name]["high"]
    assert sure["depth_residual_mm"] < 0.02 and sure["force_residual_n"] < 0.06
    for press, pose, force_n in zip(sure["presses"], TRUE_POSES, true_forces_n, strict=True):
        assert press["depth_mm"]["value"] == pytest.approx(pose[2], rel=0.03)
        assert press["force_n"]["value"] == pytest.approx(force_n, rel=0.05)
        assert press["depth_mm"]["high"] < 1.15 * press["depth_mm"]["low"]


@pytest.mark.exhaustive
def test_a_fitted_modulus_is_pressed_into(anchored, shapes):
    optics = Optics.load(anchored / "optics.npz")
    assert optics.young_mpa == pytest.approx(YOUNG_MPA, rel=0.04)
    digit = DIGIT.with_options({"optics": anchored / "optics.npz"})
    assert digit.elastomer == replace(GEL, young_mpa=optics.young_mpa)
    assert DIGIT.elastomer == GEL
    soft, hard = (
        of.press(shapes("circle-1"), PressCommand("circle-1", 0.0, 0.0, 0.0, 4.0))
        for of in (digit, DIGIT)
    )
    assert soft.depth_mm > 1.05 * hard.depth_mm
    unit = sample_unit(np.random.default_rng(0), DIGIT.spec, UnitRanges(), optics)
    assert DIGIT.with_unit(unit).elastomer == digit.elastomer
    linear = replace(GEL, young_mpa=0.5, law="linear")
    assert digit.with_options({"gel": linear}).elastomer == linear
    assert replace(digit, optics_file=None).elastomer == GEL


def test_force_goes_with_the_modulus(shapes):
    """What the modulus is fitted by: at one depth, all pressures are as many times as large."""
    command = PressCommand("hemisphere-1", 0.5, -1.0, 0.0, 3.0)
    hard = DIGIT.press(shapes("hemisphere-1"), command)
    softer = DIGIT.with_options({"gel": replace(GEL, young_mpa=0.6 * GEL.young_mpa)})
    soft = softer.press(shapes("hemisphere-1"), replace(command, force_n=1.8))
    assert soft.depth_mm == pytest.approx(hard.depth_mm, rel=1e-3)
    known, assumed = np.array([1.8, np.nan, 2.0]), np.array([3.0, 1.0, np.nan])
    assert force_ratio(known, assumed) == pytest.approx(0.6)
    with pytest.raises(T2TwinError, match="no press with a measured force"):
        force_ratio(known, np.full(3, np.nan))


@pytest.mark.parametrize(
    "content, says",
    [
        ("file;force_n\npress_00.png;1,5\n", None),
        ("force_n\n1.5\n", "has no column file"),
        ("file,force_n\npress_00.png,\n", "has no measurement"),
        ("file,force_n\nnone.png,1.5\n", "names none.png, which is not a frame"),
        ("file,force_n\npress_00.png,1.5\npress_00.png,1.6\n", "names press_00.png twice"),
        ("file,force_n\npress_00.png,0\n", "line 2, column force_n"),
        ("file,depth_mm\npress_00.png,7\n", "depth_mm of press_00.png is 7; it must be at most 4"),
        ("file,ball_diameter_mm\npress_00.png,40\n", "ball_diameter_mm of press_00.png is 40"),
    ],
)
def test_the_table_is_checked(content, says, tmp_path):
    (tmp_path / FORCES).write_text(content)
    if says is None:
        diameters_mm, depths_mm, forces_n = read_measurements(tmp_path, NAMES, 4.7, DIGIT)
        assert (diameters_mm == 4.7).all() and np.isnan(depths_mm).all()
        assert np.isfinite(forces_n).any() == ("1,5" in content)
        return
    with pytest.raises(T2TwinError, match=says):
        read_measurements(tmp_path, NAMES, 4.7, DIGIT)


def refused(folder, **numbers):
    with pytest.raises(T2TwinError) as error:
        tolerance = Tolerance(**numbers)
        calibrate(folder / "background.png", folder, 4.7, 1, tolerance=tolerance)
    return str(error.value)


def test_tolerances_that_cannot_be_are_refused(twin_frames):
    assert "ball_mm is -1" in refused(twin_frames, ball_mm=-1.0)
    assert "scale_px_per_mm is nan" in refused(twin_frames, scale_px_per_mm=float("nan"))
    assert "within its tolerance, is 0.7" in refused(twin_frames, ball_mm=4.0)
    assert "beyond 9.6 to 38.4 px/mm" in refused(twin_frames, scale_px_per_mm=15.0)
    assert "must be less" in refused(twin_frames, young_mpa=0.5)
    assert "depth_mm has no effect, without" in refused(twin_frames, depth_mm=0.0)


def test_displacements_of_held_out_presses_alone_are_refused(copied):
    table(copied, ("depth_mm", [None] * (PRESSES - 1) + [1.0]))
    assert "held-out presses only" in refused(copied)


def test_displacements_in_another_unit_are_refused(copied, monkeypatch):
    """The depths that a fit would find are given, as the fit takes long."""
    poses = TRUE_POSES[: PRESSES - 1]
    geometry = Geometry.of(Leds(DIGIT.optics.leds_mm, DIGIT.optics.sizes_mm))
    terms = Terms(geometry.count, 2, 1e-4)
    found = State(DIGIT.camera, geometry, poses, terms, np.zeros((3, terms.entries)), 0.0)
    monkeypatch.setattr(BallFit, "fit", lambda self, start=None: found)
    table(copied, ("depth_mm", TRUE_POSES[:, 2] / 10))
    assert "do not fit the frames at any scale" in refused(copied)
