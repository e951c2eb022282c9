"""Errors by force: the bins, the mean array of each, what is said of presses that touch nothing."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from spots import write_spots

from t2twin.translate.data.pairs import ImageFile, Pairs
from t2twin.translate.evaluation.baselines import (
    MAX_FORCES,
    MEAN_ARRAY_OF_FORCE,
    MIN_PAIRS,
    MIN_PRESSES,
    force_bins,
)
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.evaluation.metrics import by_force
from t2twin.translate.evaluation.records import read_evaluation

FULL_SCALE = 40000.0


def presses(force_n: np.ndarray, counts: np.ndarray | None = None, shapes: int = 4) -> Pairs:
    """Presses of these forces, (P,), which count 1000 a newton in 20 taxels unless given."""
    number = force_n.size
    names = np.array([f"s{n % shapes}" for n in range(number)])
    nothing = np.zeros(number)
    arrays = 1000.0 * np.tile(force_n[:, None], (1, 20)) if counts is None else counts
    return Pairs(
        ImageFile(Path("none")), arrays.astype(np.float32), names, names,
        nothing, nothing, nothing, force_n,
    )  # fmt: skip


def values_of_pairs(predicted: np.ndarray, pairs: Pairs) -> pd.DataFrame:
    """The errors alone."""
    squares = np.square(predicted - pairs.counts.astype(float)).mean(axis=1)
    return pd.DataFrame({"squared_error": squares})


def test_few_forces_are_a_bin_each() -> None:
    forces = np.array([0.5, 2.0, 2.004, 0.0, 8.0, 0.5])
    pairs = presses(forces)
    bins, _ = force_bins(pairs, presses(np.array([8.0])))
    assert bins["low_n"].tolist() == bins["high_n"].tolist() == [0.5, 2, 2, 0, 8, 0.5]
    rows = by_force(pairs.counts, values_of_pairs(pairs.counts, pairs), pairs, (bins, _), 1.0)
    assert [row.pairs for row in rows] == [1, 2, 2, 1]
    assert rows[2].mean_n == pytest.approx(2.002)


def test_many_forces_lie_in_bins_as_wide_in_the_logarithm() -> None:
    """Two a doubling, edges at whole powers of two; empty ones are not there; 0 is its own."""
    forces = np.concatenate([np.linspace(0.5, 0.7, MAX_FORCES), [1.0, 11.9, 0.0, np.nan]])
    bins, _ = force_bins(presses(forces), presses(np.array([4.0])))
    edges = bins.dropna().round(2).groupby(["low_n", "high_n"]).size()
    assert [*edges.index] == [(0, 0), (0.5, 0.71), (1.0, 1.41), (11.31, 16.0)]
    assert edges.tolist() == [1, MAX_FORCES, 1, 1]  # an unknown one in none


def test_the_mean_array_of_a_force_is_its_training_presses() -> None:
    """2 N are trained on often enough, 4 N once too seldom: there it is the split's own mean, but
    not of fewer than MIN_PAIRS pairs, which it would nearly equal."""
    trained = np.repeat([2.0, 4.0], [MIN_PRESSES, MIN_PRESSES - 1])
    train = presses(trained, np.tile(500.0 * trained[:, None], (1, 20)))
    pairs = presses(np.repeat([2.0, 4.0, 8.0], [2, MIN_PAIRS, MIN_PAIRS - 1]))
    bins = force_bins(pairs, train)
    assert bins[0]["mean_of"].tolist() == ["training"] * 2 + ["split"] * (2 * MIN_PAIRS - 1)
    said = bins[1]
    assert said[: 2 + MIN_PAIRS, 0].tolist() == [1000.0] * 2 + [4000.0] * MIN_PAIRS
    assert np.isnan(said[2 + MIN_PAIRS :]).all()
    said = np.nan_to_num(said, nan=7000.0)
    rows = by_force(said, values_of_pairs(said, pairs), pairs, bins, FULL_SCALE)
    assert [row.rmse_counts for row in rows] == [1000.0, 0.0, 1000.0]
    assert [row.of_mean_array for row in rows] == [1.0, None, None]  # no part of nothing


def test_what_is_predicted_where_nothing_is_touched_is_a_phantom() -> None:
    """Presses of unknown force are in no bin."""
    pairs, predicted = presses(np.array([0.0, 0.0, 8.0, np.nan])), np.full((4, 20), 50.0)
    values, bins = values_of_pairs(predicted, pairs), force_bins(pairs, pairs)
    nothing, touched = by_force(predicted, values, pairs, bins, FULL_SCALE)
    assert (nothing.phantom_counts, nothing.rmse_counts) == (1000.0, 50.0)
    assert nothing.of_mean_array is nothing.mean_of is None
    assert (touched.phantom_counts, touched.pairs) == (None, 1)
    unknown = presses(np.full(5, np.nan))
    values, bins = values_of_pairs(unknown.counts, unknown), force_bins(unknown, unknown)
    assert by_force(unknown.counts, values, unknown, bins, 1.0) == ()


@pytest.fixture(scope="module")
def forces_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of four forces and none."""
    folder = tmp_path_factory.mktemp("forces") / "data"
    return write_spots(folder, 300, 40, 0, 3, (0.0, 0.5, 1.0, 2.0, 8.0), scale=None)


def test_several_forces_have_an_entry_each_and_a_row_of_their_mean_arrays(
    runs: list[Path], forces_dir: Path, tmp_path: Path
) -> None:
    evaluation = evaluate(runs, forces_dir, "val", tmp_path)
    assert read_evaluation(tmp_path) == evaluation
    assert list(evaluation.models)[:3] == ["mean-array", MEAN_ARRAY_OF_FORCE, "nearest-neighbor"]
    for name, row in evaluation.models.items():
        assert [one.low_n for one in row.by_force] == [0.0, 0.5, 1.0, 2.0, 8.0]
        assert sum(one.pairs for one in row.by_force) == evaluation.pairs == 40
        squares = [one.pairs * one.rmse_counts**2 for one in row.by_force]
        assert np.sqrt(sum(squares) / 40) == pytest.approx(row.overall["rmse_counts"])
        for one in row.by_force[1:]:
            assert one.mean_of == "training" and one.phantom_counts is None
            if name == MEAN_ARRAY_OF_FORCE:
                assert one.of_mean_array == pytest.approx(1.0, rel=1e-6)
        assert row.by_force[0].phantom_counts is not None
    known, blind = (evaluation.models[name] for name in (MEAN_ARRAY_OF_FORCE, "mean-array"))
    assert known.overall["rmse_counts"] < blind.overall["rmse_counts"]
    run = evaluation.models["resnet18"]
    assert (run.same_data, run.trained_recipe, run.trained_pairs) == (False, "smoke", 32)
    assert run.trained_steps == 3 * 4  # epochs of 32 pairs in batches of 8
    assert evaluation.paper == {} and evaluation.recipe is None
