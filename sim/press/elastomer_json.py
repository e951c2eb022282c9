"""An elastomer's properties as JSON can hold them."""

from dataclasses import asdict
from typing import Any

import numpy as np

from t2twin.sim.press.elastomer import Elastomer


def elastomer_json(elastomer: Elastomer) -> dict[str, Any]:
    """All properties by name; an infinite radius, a flat side's, is None: JSON has no infinity."""
    return {key: None if value == np.inf else value for key, value in asdict(elastomer).items()}
