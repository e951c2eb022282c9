"""What the report says of two errors, in words."""

from dataclasses import fields

import pytest

from t2twin.report.sections import results
from t2twin.translate.evaluation.records import Figures, Intervals, ModelRow


def row(rmse_counts: float, run: str | None = None) -> ModelRow:
    nothing = Intervals(**{field.name: None for field in fields(Intervals)})
    overall = Figures(1, rmse_counts, 1.0, 1.0, None, None, None, None, None, None, None)
    return ModelRow(overall, {}, {}, nothing, run)


def models(mean: float, nearest: float, run: float) -> dict[str, ModelRow]:
    trivial = {"mean-array": row(mean), "nearest-neighbour": row(nearest)}
    return trivial | {"resnet18": row(run, "somewhere")}


@pytest.mark.parametrize(
    "split, errors, said",
    [
        ("val", (4000, 2000, 3000), "25.0 % below that of the mean array and 50.0 % above"),
        ("test", (5000, 5000, 5000), "equal to that of the mean array and equal to"),
        ("test", (0, 0, 3), "above that of the mean array and above"),  # arrays that are all alike
        ("test", (0, 0, 0), "equal to that of the mean array and equal to"),
    ],
)
def test_sentences_follow_the_numbers(
    split: str, errors: tuple[float, float, float], said: str
) -> None:
    [(where, name, of_mean_array, of_nearest)] = results.comparisons({split: models(*errors)})
    assert (where, name) == (split, "resnet18")
    assert f"{of_mean_array} that of the mean array and {of_nearest}" == said
