"""t2twin simdata"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from t2twin.sim.dataset.info import DatasetInfo


def simdata(
    scale: Annotated[str | None, tyro.conf.arg(metavar="SCALE")] = None,
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    seed: int = 0,
    layout: str = "cyskin-20",
    imperfections: str = "white",
    calibration: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None,
    primitives: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None,
    verify: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
) -> None:
    """Make the paired dataset, or end one that was begun; or check one with --verify.

    Args:
        scale: smoke (about 100 pairs), small (about 1,000) or paper (20,076).
        out: Folder to write into; data/SCALE unless given.
        workers: Processes that press at once; as many as there are cores unless given.
        seed: Seed of all noise. Same seed, same bytes.
        layout: Taxel layout: a name, or a JSON or CSV file with x_mm and y_mm.
        imperfections: What the CySkin adds: none, white, untouched or all.
        calibration: The DIGIT's optics, as t2twin calibrate writes them; the shipped ones unless
            given.
        primitives: Folder where prepared shapes are kept; one in the user's cache unless given.
        scheduler: Address of a Dask scheduler whose workers make the shards instead, as in
            tcp://10.0.0.1:8786. They must see the folders under the same paths.
        verify: Make nothing; check this dataset, name what is broken, and exit with 1 if anything
            is.
    """
    from t2twin.primitives_cad.errors import T2TwinError

    if verify is not None:
        sys.exit(_verify(verify))
    if scale is None:
        raise T2TwinError("--scale is missing: smoke, small or paper (or --verify DIR)")
    if scheduler is not None and workers is not None:
        raise T2TwinError(
            "--workers is for this machine; on a cluster Dask says how many there are"
        )

    import t2twin

    folder = out or Path("data") / scale
    info = t2twin.make_dataset(
        folder,
        scale,
        seed=seed,
        workers=workers,
        sensors=t2twin.Twin(calibration, layout, imperfections).sensors,
        cache=primitives,
        scheduler=scheduler,
    )
    print(f"{_pairs(info)} pairs in {folder}, {_size(folder, info)}")


def _verify(folder: Path) -> int:
    """Exit status."""
    import t2twin
    from t2twin.sim.dataset.store import read_info

    broken = t2twin.verify_dataset(folder)
    for problem in broken:
        print(problem)
    info = read_info(folder)
    if broken:
        again = (
            "; the same `t2twin simdata` remakes its shards, no others" if info.is_simulated else ""
        )
        print(f"{folder} is broken in {len({problem.part for problem in broken})} files{again}")
        return 1
    print(f"{folder} is whole: {_pairs(info)} pairs, {_size(folder, info)}")
    return 0


def _pairs(info: "DatasetInfo") -> str:
    pairs = info.pairs
    return f"{pairs['train']} training, {pairs['val']} validation and {pairs['test']} test"


def _size(folder: Path, info: "DatasetInfo") -> str:
    size = sum((folder / path).stat().st_size for path in info.shards)
    pairs = sum(info.pairs.values())
    return f"{size / 2**20:.0f} MiB ({size / pairs / 1e3:.1f} kB a pair)"
