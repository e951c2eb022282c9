"""Odd meshes: each is pressed with the right surface, or refused with advice that works."""

import re
from pathlib import Path

import numpy as np
import pytest
from attempt import PROGRESS
from odd_meshes import FORMATS, odd, write

from t2twin.cli import main
from t2twin.primitives_cad import catalogue

SAMPLE, COUNT = 14, 504
"""Seeds that each run tries, and those of the exhaustive run: multiples of the formats."""

ADVICE = re.compile(r"--scale \S+|--x-mm \S+ --y-mm \S+|--center")

MAX_ADVICE = 3
"""Sentences that may be followed one after the other: a scale, then a place."""

TOLERANCE_MM, SHARE = 0.03, 0.97
"""Error of heights, mm, and share of the points with at most that error."""


def pressed(path: Path, capfd: pytest.CaptureFixture) -> tuple[list[str], str]:
    """Presses a file, and follows the advice of each refusal; returns the options that were needed,
    and the last sentence, empty after success."""
    options: list[str] = []
    for _ in range(MAX_ADVICE):
        said = run(path, options, capfd)
        if not said:
            return options, ""
        lines = [line for line in said.splitlines() if not PROGRESS.search(line)]
        assert len(lines) == 1 and lines[0].startswith("t2twin: "), said
        advice = ADVICE.findall(said)
        if not advice:
            return options, said
        for other in advice[1:]:  # all of it must work
            assert not run(path, options + other.split(), capfd), (other, said)
        options += advice[0].split()
    pytest.fail(f"{path.name}: advice without end: {said}")


def run(path: Path, options: list[str], capfd: pytest.CaptureFixture) -> str:
    """Standard error of a press that fails, or an empty text."""
    out = path.with_suffix("")
    words = ["press", str(path), "--sensor", "digit", "--force-n", "2", "--out", str(out), *options]
    try:
        main(words)
    except SystemExit as stop:
        assert stop.code == 2
        return capfd.readouterr().err
    said = capfd.readouterr()
    assert "digit: 2.00 N" in said.out
    return ""


def check_surface(it, path: Path, options: list[str]) -> None:
    """The prepared shape's heights are the mesh's, up to its scale and place."""
    scale = float(options[options.index("--scale") + 1]) if "--scale" in options else None
    shape = catalogue.load(path, scale=scale, center="--center" in options)
    bounds = it.mesh.bounds[:, :2]
    factor = float(np.ptp(shape.mesh.bounds[:, 0]) / np.ptp(bounds[:, 0]))
    assert np.ptp(shape.mesh.bounds[:, 1]) == pytest.approx(factor * np.ptp(bounds[:, 1]), rel=0.02)
    moved = shape.mesh.bounds[:, :2].mean(axis=0) - factor * bounds.mean(axis=0)
    surface = shape.surface
    rng = np.random.default_rng(0)
    x, y = (rng.uniform(axis[2], axis[-3], 20_000) for axis in (surface.x_mm, surface.y_mm))

    def top(dx: float, dy: float) -> np.ndarray:
        places = np.stack([x + dx, y + dy]) - moved[:, None]
        return factor * it.top(*(places / factor))

    near = 2 * surface.pitch_mm
    around = np.stack([top(dx, dy) for dx in (-near, 0, near) for dy in (-near, 0, near)])
    wanted = top(0.0, 0.0)
    # Between two points a map has no wall.
    known = np.abs(around.mean(axis=0) - wanted) < TOLERANCE_MM / 3
    assert known.sum() > 20
    wrong = surface.sample(x[known], y[known]) - wanted[known]
    wrong -= np.median(wrong)
    allowed = TOLERANCE_MM * max(factor, 1.0) + surface.pitch_mm / 5
    assert (np.abs(wrong) < allowed).mean() >= SHARE, np.quantile(np.abs(wrong), [0.5, 0.9, 0.97])


def attempt(seed: int, folder: Path, capfd: pytest.CaptureFixture) -> bool:
    """Whether the mesh of a seed can be pressed, after its advice."""
    it, kind = odd(seed), FORMATS[seed % len(FORMATS)]
    path = folder / f"odd.{kind}"
    write(it, kind, path)
    options, refused = pressed(path, capfd)
    if refused:
        largest = np.ptp(it.mesh.vertices, axis=0).max() / it.unit_mm
        largest *= 1000.0 if kind == "glb" else 1.0
        assert "at most 1000 mm" in refused and largest > 1000.0, (it.name, refused)
        return False
    check_surface(it, path, options)
    return True


@pytest.mark.parametrize("seed", range(SAMPLE))
def test_odd_meshes_are_pressed_or_their_advice_works(seed, tmp_path, capfd):
    attempt(seed, tmp_path, capfd)


@pytest.mark.exhaustive
def test_many_odd_meshes(tmp_path, capfd):
    faults, count = [], 0
    for seed in range(SAMPLE, COUNT):
        folder = tmp_path / str(seed)
        folder.mkdir()
        try:
            count += attempt(seed, folder, capfd)
        except (Exception, pytest.fail.Exception) as error:
            faults.append(f"{odd(seed).name}: {error!r}"[:600])
    assert not faults, "\n".join(faults)
    assert count > 0.7 * (COUNT - SAMPLE)
