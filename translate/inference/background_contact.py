"""A contact in a background frame, which must show none."""

import numpy as np

from t2twin.translate.inference.field_predictor import FieldPredictor
from t2twin.translate.inference.load import load_run
from t2twin.translate.runs.config import load_config, pretrained_runs, resolve_run


def contact_warnings(frame: np.ndarray, name: str, sensor: str) -> list[str]:
    """A sentence for each pretrained run of a sensor that finds a contact in a background frame.

    frame: (rows, columns, 3) uint8, upright. name: names it in the sentences.
    """
    said = []
    for run_name in pretrained_runs():
        if load_config(resolve_run(run_name)).data.camera.sensor != sensor:
            continue
        run = load_run(run_name)
        if isinstance(run, FieldPredictor) and run.shows_contact(frame)[0]:
            said.append(f"{name} shows a contact, by {run_name}; expected a frame without")
    return said
