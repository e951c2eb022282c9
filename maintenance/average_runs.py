"""Averages the weights of a run and of a later run that was initialized with it.

    python -m maintenance.average_runs EARLIER LATER SHARE OUT
    t2twin calibrate-uncertainty OUT --data DATASET

OUT is a copy of LATER with the weights (1 - SHARE) EARLIER + SHARE LATER.
"""

import sys
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.translate.runs.checkpoint import average_runs

if __name__ == "__main__":
    try:
        earlier, later, share, out = sys.argv[1:]
        average_runs(Path(earlier), Path(later), float(share), Path(out))
    except T2TwinError as error:
        sys.exit(str(error))
