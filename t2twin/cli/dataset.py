"""t2twin simdata, t2twin import-pairs and t2twin convert"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from msgspec import structs

from t2twin.core.errors import T2TwinError, counted
from t2twin.core.frame_order import UPRIGHT, FrameOrder

if TYPE_CHECKING:
    from t2twin.sim.dataset.info import DatasetInfo


def simdata(
    scale: str | None = None,
    out: Path | None = None,
    workers: int | None = None,
    recipe: str | None = None,
    seed: int | None = None,
    source: str | None = None,
    target: str | None = None,
    layout: str | None = None,
    imperfections: str | None = None,
    optics: str | None = None,
    renderer: Literal["baked", "pyrender"] | None = None,
    primitives: Path | None = None,
    scheduler: str | None = None,
    verify: Path | None = None,
) -> None:
    """Make a paired dataset or continue one; or check one with --verify.

    Args:
        scale: Of the protocol: smoke (about 100 pairs), light (1,000), small (about 1,200) or
            paper (20,076).
        out: Folder to write; default data/SCALE or data/RECIPE.
        workers: Number of processes; default: the number of cores.
        recipe: Instead of a scale and the options layout to renderer, a recipe: a TOML file, or the
            name of a bundled one. Bundled are paper, open, open-8n, union, unseen-forces, forces,
            moving, contact, shipped, shipped-2, pretrained-3, pretrained-4, mini-1 and new-light.
        seed: Random seed; default 0, or the recipe's. The same seed gives the same bytes.
        source: The first sensor: a bundled one (t2twin sensors lists them) or a sensor file;
            default digit, or the recipe's.
        target: The second sensor; default cyskin-20, or the recipe's.
        layout: Taxel layout of taxel arrays: a name, or a JSON or CSV file with x_mm and y_mm.
        imperfections: Errors of taxel arrays, by the name in the sensor's file, such as none or
            white; default recorded, or else white.
        optics: Optics of gel cameras, as written by t2twin calibrate; default: the sensor's.
        renderer: What renders the images: baked, in milliseconds (the default), or pyrender.
        primitives: Folder of prepared shapes; default: in the user's cache.
        scheduler: Address of a Dask scheduler, such as tcp://10.0.0.1:8786, whose workers make the
            shards. They must have the folders under the same paths.
        verify: Check this dataset instead, list what is damaged, and exit with 1 if anything is.
    """
    _refuse({name for name, value in locals().items() if value is not None})

    import t2twin
    from t2twin.sim.sampling.recipe import load_recipe
    from t2twin.sim.sensors.pair import SensorPair

    if verify is not None:
        sys.exit(_verify(verify))
    made, sensors = recipe, None
    roles = {name: each for name, each in (("source", source), ("target", target)) if each}
    if recipe is None:
        sensors = SensorPair.of(**roles, layout=layout, optics=optics, renderer=renderer)
        sensors = sensors.with_imperfections(imperfections)
    elif roles:
        made = structs.replace(load_recipe(recipe), **roles)
    folder = out or Path("data") / (scale or Path(recipe or "").stem)
    info = t2twin.make_dataset(
        folder, scale, seed, workers, sensors, primitives, scheduler=scheduler, recipe=made
    )
    print(f"{_pairs(info)} pairs in {folder}, {_size(folder, info)}")


def _refuse(given: set[str]) -> None:
    """Raises T2TwinError for options that have no effect beside another one."""
    of_recipe = {"layout", "optics", "renderer", "imperfections"}
    for option, others in (("verify", given), ("recipe", of_recipe)):
        found = [f"--{name}" for name in sorted(given & others - {option})]
        if option in given and found:
            has = f"{', '.join(found)} {'has' if len(found) == 1 else 'have'}"
            raise T2TwinError(
                f"{has} no effect beside --{option}; leave out --{option} or the rest"
            )


def _verify(folder: Path) -> int:
    """Check a dataset; returns the exit status."""
    import t2twin
    from t2twin.sim.dataset.store import INFO, read_info

    faults = t2twin.verify_dataset(folder)
    for path, reason in faults:
        print(f"{path}: {reason}")
    info = read_info(folder)
    if faults:
        damaged = {path for path, _ in faults}
        own = counted(len(damaged & {INFO, *info.shards}), "file")
        repair = f"; the same `t2twin simdata` remakes {own}" if info.recipe else ""
        print(f"{folder} is damaged in {counted(len(damaged), 'file')}{repair * (own[0] != '0')}")
        return 1
    print(f"{folder} is complete: {_pairs(info)} pairs, {_size(folder, info)}")
    return 0


def import_pairs(
    table: tyro.conf.Positional[str],
    out: Path,
    source: str = "digit",
    target: str = "cyskin-20",
    layout: str | None = None,
    full_scale: int | None = None,
    seed: int = 0,
    order: Annotated[FrameOrder, tyro.conf.arg(name="")] = UPRIGHT,
) -> None:
    """Convert and check your own pairs.

    A CSV file next to its images has a column image (file of the image) and taxel_0, taxel_1 ...
    in the layout's order, separated by commas, semicolons or tabs; Parquet has image (the same, or
    the image itself) and taxels (a list). Columns split (train, val, test), shape, family, x_mm,
    y_mm, yaw_rad and force_n are optional; without split, the pairs are split randomly into 80, 10
    and 10 %.

    Args:
        table: A .csv or .parquet file, or a folder with one.
        out: Folder of the dataset to write.
        source: A gel camera with the view of the images: a bundled sensor or a sensor file.
        target: A taxel array like yours.
        layout: Your taxels: a name, or a JSON or CSV file; default: those of the target.
        full_scale: Count at which your taxels saturate; default: the target's.
        seed: Seed of the random split.
    """
    import t2twin

    info = t2twin.import_pairs(table, out, layout, full_scale, seed, order, source, target)
    print(f"{_pairs(info)} pairs in {out}")


def convert(dataset: tyro.conf.Positional[str], to: Literal["lerobot"], out: Path) -> None:
    """Convert a dataset to the format of another project.

    Args:
        dataset: Folder of a dataset.
        to: lerobot, the format v3.0 of LeRobot: a press or slide is an episode, images stay PNG,
            counts, forces and shear are float features.
        out: Folder to write, new or empty.
    """
    from t2twin.sim.dataset.lerobot import convert_to_lerobot

    info = convert_to_lerobot(dataset, out)
    print(f"{info['total_episodes']} episodes with {info['total_frames']} frames in {out}")


def _pairs(info: "DatasetInfo") -> str:
    return "{train} training, {val} validation and {test} test".format(**info.pairs)


def _size(folder: Path, info: "DatasetInfo") -> str:
    size = sum((folder / path).stat().st_size for path in info.shards)
    return f"{size / 2**20:.0f} MiB ({size / sum(info.pairs.values()) / 1e3:.1f} kB a pair)"
