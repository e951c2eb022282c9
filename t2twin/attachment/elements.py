"""The elements of a sensor in a MuJoCo model, and whether a state of the model can be read."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from typing import NamedTuple

import mujoco
import numpy as np

from t2twin.attachment.contacts import Pose
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError

BODY, SURFACE, FRAME = "body", "surface", "frame"
"""Names of a sensor's elements in the model, after the sensor's name and a slash."""


class Elements(NamedTuple):
    """Ids of a sensor's site and geom in a model."""

    site: int
    geom: int


def find_elements(model: "mujoco.MjModel", name: str, suffix: str = "") -> Elements:
    """The elements of a sensor, whose names may have got a prefix and a suffix.

    suffix: that which is known.
    Raises T2TwinError if there is no such sensor, or if there are several.
    """
    own = f"{name}/{FRAME}{suffix}"
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, own)
    if site < 0:
        names = [model.site(number).name for number in range(model.nsite)]
        found = [number for number, each in enumerate(names) if own in each]
        if not found:
            raise T2TwinError(
                f"the model has no site {own}; expected a model compiled from the spec to which "
                f"{name} was attached"
            )
        if len(found) > 1:
            there = ", ".join(names[number] for number in found)
            raise T2TwinError(
                f"the model has several sites {own}: {there}; use {name}.with_prefix(PREFIX), one "
                "for each"
            )
        site, own = found[0], names[found[0]]
    surface = own.replace(f"{name}/{FRAME}", f"{name}/{SURFACE}")
    return Elements(site, mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, surface))


def kept_away(model: "mujoco.MjModel", sensor: int) -> list[str]:
    """Names of moving geoms that collide with something, but not with the geom of a sensor."""
    kinds, affinities = model.geom_contype, model.geom_conaffinity
    collides = (kinds != 0) | (affinities != 0)
    collides[model.pair_geom1] = collides[model.pair_geom2] = True
    meets = (kinds & affinities[sensor]) | (kinds[sensor] & affinities) != 0
    paired = (model.pair_geom1 == sensor) | (model.pair_geom2 == sensor)
    meets[model.pair_geom1[paired]] = meets[model.pair_geom2[paired]] = True
    welded = model.body_weldid[model.geom_bodyid]
    found = np.flatnonzero(collides & ~meets & (welded != welded[sensor]) & (welded != 0))
    return [model.geom(number).name or f"geom {number}" for number in found.tolist()]


def check_state(model: "mujoco.MjModel", data: "mujoco.MjData") -> None:
    """Raises T2TwinError for a model or data that cannot be read."""
    for value, name, kind in (
        (model, "model", mujoco.MjModel),
        (data, "data", mujoco.MjData),
    ):
        if not isinstance(value, kind):
            raise T2TwinError(
                f"{name} is {arguments.describe(value)}; expected a mujoco.{kind.__name__} "
                "(mjx.get_data copies a state of MJX into one)"
            )
    if model.signature != data.signature:
        raise T2TwinError("data is of another model; expected a mujoco.MjData of this model")
    for name in ("time", "qpos", "qvel", "xpos", "xmat", "efc_force"):
        if not np.isfinite(getattr(data, name)).all():
            raise T2TwinError(
                f"data.{name} is not finite: the simulation has diverged; take a smaller time "
                "step, or reset the state"
            )


def frame_of(data: "mujoco.MjData", site: int) -> Pose:
    """The sensor frame. Raises T2TwinError for data without poses."""
    rotation = data.site_xmat[site].reshape(3, 3).copy()
    if not rotation.any():
        raise T2TwinError(
            "data has no poses yet; call mujoco.mj_forward(model, data) before the first read"
        )
    return Pose(rotation, data.site_xpos[site].copy())
