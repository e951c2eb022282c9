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
    """Export a trained run as an ONNX file, from pixels to counts and tactile images.

    Args:
        run: Folder of a trained run, or name of a pretrained run. Default: the pretrained field. A
            folder called field is ./field.
        out: Output file. Default: MODEL.onnx in RUN, for a pretrained run in the working directory.
        layout: Taxel layout (name, or JSON or CSV file) that a touch2touch or field run is read at.
            Default: the run's own.
        force: Replace an existing file.
    """
    from t2twin.core.files import check_new_file
    from t2twin.translate.inference.load import load_run
    from t2twin.translate.inference.onnx_export import export_onnx
    from t2twin.translate.models.distributed import use_all_cores
    from t2twin.translate.runs.config import DEFAULT_RUN, HOME

    if out is not None:
        check_new_file(out, force)
    use_all_cores()
    loaded = load_run(DEFAULT_RUN if run is None else run, layout)
    if out is None:
        folder = Path() if loaded.run_dir.parent == HOME else loaded.run_dir
        out = folder / f"{loaded.config.model}.onnx"
        check_new_file(out, force)
    difference = export_onnx(loaded, out)
    print(f"counts differ by at most {difference:.3f} from PyTorch's on random images")
    print(f"written to {out}")
