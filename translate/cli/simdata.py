"""t2twin simdata"""

from pathlib import Path
from typing import Annotated

import tyro


def simdata(
    scale: str,
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    workers: int | None = None,
    seed: int = 0,
    layout: str = "cyskin-20",
    imperfections: str = "white",
    primitives: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
) -> None:
    """Make the paired dataset, or end one that was begun.

    Args:
        scale: smoke (about 100 pairs), small (about 1,000) or paper (20,076).
        out: Folder to write into; data/SCALE unless given.
        workers: Processes that press at once; as many as there are cores unless given.
        seed: Seed of all noise. Same seed, same bytes.
        layout: Taxel layout: a name, or a JSON or CSV file with x_mm and y_mm.
        imperfections: What the CySkin adds: none, white, untouched or all.
        primitives: Folder where prepared shapes are kept; data/primitives unless given.
    """
    from sim.bench import Bench, CySkin
    from sim.generate import generate

    folder = out or Path("data") / scale
    bench = Bench(cyskin=CySkin(layout_source=layout, imperfections=imperfections))
    info = generate(folder, scale, seed=seed, workers=workers, bench=bench, cache=primitives)
    pairs = info["pairs"]
    size = sum((folder / path).stat().st_size for path in info["shards"]) / 2**20
    print(
        f"{pairs['train']} training, {pairs['val']} validation and {pairs['test']} test pairs "
        f"in {folder}, {size:.0f} MiB"
    )
