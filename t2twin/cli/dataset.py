"""t2twin import-pairs

t2twin simdata
"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro


def import_pairs(
    source: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="PAIRS")]],
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    layout: str = "cyskin-20",
    full_scale: int = 40_000,
    seed: int = 0,
) -> None:
    """Bring your own pairs into the dataset's format, checked on the way.

    A CSV file beside its pictures has a column image (the picture's file) and taxel_0, taxel_1 ...
    in the layout's order, with commas, semicolons or tabs between; Parquet has image (the same, or
    the picture itself) and taxels (a list). Columns split (train, val, test), shape, family, x_mm,
    y_mm, yaw_rad and force_n are taken where they are there; without split, 80, 10 and 10 % are
    drawn at random.

    Args:
        source: A .csv or .parquet file, or a folder that holds one.
        out: Folder of the dataset to make.
        layout: Your taxels: a name, or a JSON or CSV file with x_mm and y_mm.
        full_scale: Where your taxels saturate, counts.
        seed: Draws the splits where the rows name none.
    """
    import t2twin

    pairs = t2twin.import_pairs(source, out, t2twin.load_layout(layout), full_scale, seed).pairs
    print(
        f"{pairs['train']} training, {pairs['val']} validation and {pairs['test']} test pairs "
        f"in {out}"
    )


if TYPE_CHECKING:
    from t2twin.sim.dataset.info import DatasetInfo


def simdata(
    scale: Annotated[str | None, tyro.conf.arg(metavar="SCALE")] = None,
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    world: Annotated[str | None, tyro.conf.arg(metavar="WORLD")] = None,
    seed: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    layout: Annotated[str | None, tyro.conf.arg(metavar="LAYOUT")] = None,
    imperfections: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None,
    calibration: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None,
    optics: Annotated[Literal["baked", "pyrender"] | None, tyro.conf.arg(metavar="NAME")] = None,
    primitives: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None,
    verify: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
) -> None:
    """Make a paired dataset, or end one that was begun; or check one with --verify.

    Args:
        scale: Of the protocol: smoke (about 100 pairs), small (about 1,000) or paper (20,076).
        out: Folder to write into; data/SCALE or data/WORLD unless given.
        workers: Processes that press at once; as many as there are cores unless given.
        world: Instead of a scale: the name of a recipe that ships (paper, open, open-8n, union,
            unseen-forces, forces, shipped, shipped-2), or a TOML file of your own, which says what
            is pressed, where, how hard and in which light.
        seed: Seed of all that is drawn; 0, or the recipe's, unless given. Same seed, same bytes.
        layout: Taxel layout: a name, or a JSON or CSV file with x_mm and y_mm; cyskin-20 unless
            given. A world names its own.
        imperfections: What the CySkin adds: none, white (unless given), baseline or all. A world
            names its own.
        calibration: The DIGIT's optics, as t2twin calibrate writes them; the shipped ones unless
            given. A world names its own.
        optics: What makes the pictures: baked, in milliseconds (unless given), or pyrender itself,
            in seconds. A world names its own.
        primitives: Folder where prepared shapes are kept; one in the user's cache unless given.
        scheduler: Address of a Dask scheduler whose workers make the shards instead, as in
            tcp://10.0.0.1:8786. They must see the folders under the same paths.
        verify: Make nothing; check this dataset, name what is broken, and exit with 1 if anything
            is.
    """
    from t2twin.core.errors import T2TwinError
    from t2twin.sim.cyskin.layout import DEFAULT_LAYOUT

    if verify is not None:
        sys.exit(_verify(verify))
    own = {
        "--layout": layout,
        "--imperfections": imperfections,
        "--calibration": calibration,
        "--optics": optics,
    }
    _check_asked(scale, world, own)
    if scheduler is not None and workers is not None:
        raise T2TwinError(
            "--workers is for this machine; on a cluster Dask says how many there are"
        )

    import t2twin

    sensors = None
    if scale is not None:
        sensors = t2twin.Twin(
            calibration,
            DEFAULT_LAYOUT if layout is None else layout,
            "white" if imperfections is None else imperfections,
            optics=optics or "baked",
        ).sensors
    folder = out or Path("data") / (scale or Path(world or "").stem)
    info = t2twin.make_dataset(
        folder,
        scale,
        seed=seed,
        workers=workers,
        sensors=sensors,
        cache=primitives,
        scheduler=scheduler,
        world=world,
    )
    print(f"{_pairs(info)} pairs in {folder}, {_size(folder, info)}")


def _check_asked(scale: str | None, world: str | None, own: dict[str, str | None]) -> None:
    """Raises T2TwinError unless one of scale and world is given, and what goes with it. own: the
    flags of what a world names itself."""
    from t2twin.core.errors import T2TwinError

    if scale is None and world is None:
        raise T2TwinError(
            "--scale is missing: smoke, small or paper (or --world WORLD, or --verify DIR)"
        )
    if world is None:
        return
    given = [flag for flag, value in {"--scale": scale, **own}.items() if value is not None]
    if given:
        raise T2TwinError(f"{given[0]} does not go with --world, whose recipe says all of it")


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
