"""t2twin export"""

from pathlib import Path
from typing import Annotated

import tyro


def export(
    run: Annotated[str | None, tyro.conf.arg(metavar="RUN")] = None,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    layout: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None,
    force: bool = False,
) -> None:
    """Write a trained run as an ONNX file: pixels in, counts and tactile images out.

    Args:
        run: Folder of a trained run, or the name of a pretrained run; the pretrained field unless
            given. A name stands for the pretrained run; a folder called field is ./field.
        out: File to write; unless given, MODEL.onnx in RUN, or in the working directory of a
            pretrained run.
        layout: Taxel layout (name, or JSON or CSV file) to read a touch2touch or field run
            at; the run's own unless given.
        force: Replace the file where it exists.
    """
    from t2twin.core.files import check_new_file
    from t2twin.translate.inference.onnx_export import export_onnx
    from t2twin.translate.inference.predictor import load_run
    from t2twin.translate.models.distributed import use_all_cores
    from t2twin.translate.runs.pretrained import DEFAULT_RUN, HOME

    if out is not None:
        check_new_file(out, force)
    use_all_cores()
    loaded = load_run(DEFAULT_RUN if run is None else run, layout)
    if out is None:
        folder = Path() if loaded.run_dir.parent == HOME else loaded.run_dir
        out = folder / f"{loaded.config.model}.onnx"
        check_new_file(out, force)
    apart = export_onnx(loaded, out)
    print(f"counts within {apart:.3f} of PyTorch's on random images")
    print(f"written to {out}")
