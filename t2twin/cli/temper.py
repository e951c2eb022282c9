"""t2twin temper"""

from pathlib import Path
from typing import Annotated

import tyro


def temper(
    run: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="RUN")]],
    data: Annotated[
        tuple[Path, ...], tyro.conf.arg(metavar="DIR", help_behavior_hint="(one or more)")
    ],
) -> None:
    """Put a field run's standard deviations right anew, on validation presses of several worlds.

    Args:
        run: Folder of a trained field run; its best weights keep what is found.
        data: Folders of datasets whose pairs hold the field, the run's own among them. Each one's
            validation presses have the same say.
    """
    from t2twin.primitives_cad.errors import T2TwinError
    from t2twin.translate.distributed import use_all_cores
    from t2twin.translate.temper import temper as fit

    if not data:
        raise T2TwinError("there is no dataset to temper on; give folders with --data")
    use_all_cores()
    presses = fit(run, data)
    print(f"standard deviations fitted on {presses:,} presses; written to {run}")
