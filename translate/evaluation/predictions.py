"""predictions.npz: what each row of an evaluation says of every pair, with the presses.

It holds "truth" and one (P, N) array a model, by the models' names, and by pair "shape", "family",
"x_mm", "y_mm", "yaw_rad" and "force_n". Of a model that says how sure it is there is another
(P, N) array, "std of " and its name.

Shape letters: P pairs, N taxels.
"""

import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.writing import whole_file

PREDICTIONS = "predictions.npz"
TRUTH, STD = "truth", "std of "
OF_PAIRS = ("shape", "family", "x_mm", "y_mm", "yaw_rad", "force_n")
"""Arrays that are no model's."""


@dataclass(frozen=True)
class Predictions:
    """Counts that the models predict, beside the true ones.

    truth: (P, N), counts. by_model: the same by the model's name. shapes, families: (P,) names.
    x_mm, y_mm, yaw_rad, force_n: (P,) the presses. std_by_model: (P, N), counts, the standard
    deviations of the models that say them.
    """

    truth: np.ndarray
    by_model: dict[str, np.ndarray]
    shapes: np.ndarray
    families: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    yaw_rad: np.ndarray
    force_n: np.ndarray
    std_by_model: dict[str, np.ndarray] = field(default_factory=dict)

    def rmse_counts(self, model: str) -> np.ndarray:
        """RMSE of each pair, over its taxels: (P,), counts."""
        return np.sqrt(np.square(self.by_model[model] - self.truth).mean(axis=1, dtype=float))


def read_predictions(folder: Path) -> Predictions:
    """The predictions in an evaluation's folder.

    Raises T2TwinError where the file is missing or damaged.
    """
    path = folder / PREDICTIONS
    if not path.is_file():
        raise T2TwinError(f"{folder} holds no {PREDICTIONS}; evaluate the runs again")
    try:
        with path.open("rb") as file, np.load(file) as arrays:
            truth = arrays[TRUTH]
            of_pairs = [arrays[name] for name in OF_PAIRS]
            rest = {name: arrays[name] for name in arrays.files if name not in (TRUTH, *OF_PAIRS)}
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        raise T2TwinError(f"{path} is damaged; evaluate the runs again") from None
    stds = {name: rest.pop(name) for name in list(rest) if name.startswith(STD)}
    stds = {name.removeprefix(STD): of_model for name, of_model in stds.items()}
    return Predictions(truth, rest, *of_pairs, std_by_model=stds)


def write_predictions(folder: Path, predictions: Predictions) -> None:
    """Writes folder/predictions.npz, whole or not at all."""
    of_pairs = (
        predictions.shapes,
        predictions.families,
        predictions.x_mm,
        predictions.y_mm,
        predictions.yaw_rad,
        predictions.force_n,
    )
    with whole_file(folder / PREDICTIONS) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            **{TRUTH: predictions.truth},
            **predictions.by_model,
            **{f"{STD}{name}": stds for name, stds in predictions.std_by_model.items()},
            **dict(zip(OF_PAIRS, of_pairs, strict=True)),
        )
