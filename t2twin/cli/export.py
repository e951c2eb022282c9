"""t2twin export"""

from pathlib import Path
from typing import Annotated

import tyro


def export(
    run: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="RUN")]],
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    layout: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None,
) -> None:
    """Write a trained run as an ONNX file: pixels in, counts and tactile images out.

    Args:
        run: Folder of a trained run, or the name of one that ships: field.
        out: File to write; RUN/MODEL.onnx unless given.
        layout: Taxel layout (name, or JSON or CSV file) to read a touch2touch or field run
            at; the run's own unless given.
    """
    from t2twin.translate.distributed import use_all_cores
    from t2twin.translate.export import export_onnx
    from t2twin.translate.predict import load_run

    use_all_cores()
    loaded = load_run(run, layout)
    path = out or run / f"{loaded.config.model}.onnx"
    apart = export_onnx(loaded, path)
    print(f"counts within {apart:.3f} of PyTorch's on random images")
    print(f"written to {path}")
