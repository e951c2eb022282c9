"""How far a sensor's collision geom may reach behind its base: as far as its mount."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import mujoco
import numpy as np

from t2twin.attachment.contacts import Pose
from t2twin.sim.contact.elastomer import Elastomer

BACKING_M = 0.02
"""Largest depth of a geom behind its base, m. Assumed: less than a DIGIT's housing, and more than
a body moves in a time step of 5 ms after a fall of 0.1 m, three times 7 mm."""

UNKNOWN_M = 0.008
"""Depth where the spec does not compile yet, m (assumed: most fingers are thicker)."""

RAYS = (-0.25, 0.0, 0.25)
"""Places of rays along both sides of the pad, in shares of its sides."""

CLEARANCE_M = 1e-3
"""Distance of the geom from the mount's far side, m (assumed: more than bodies at rest there sink
in with MuJoCo's default contact)."""

START_M = 1e-4
"""Depth below the base at which a ray starts, m (assumed)."""


def backing_m(
    spec: "mujoco.MjSpec", parent: str, is_site: bool, pos: np.ndarray, quat: np.ndarray,
    elastomer: Elastomer,
) -> float:  # fmt: skip
    """Depth behind a sensor's base, m: the least thickness of the geoms that it is welded to, 0 for
    a mount that is narrower than half the pad.

    parent: name of the site or body of the mount. pos, quat: pose of the base on it.
    BACKING_M where there is nothing behind the base, and UNKNOWN_M for a spec that is not complete.
    """
    try:
        model = spec.copy().compile()
    except (ValueError, mujoco.FatalError):
        return UNKNOWN_M
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    if is_site:
        place, body = data.site(parent), int(model.site(parent).bodyid[0])
    else:
        place, body = data.body(parent), model.body(parent).id
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, quat)
    outer = place.xmat.reshape(3, 3)
    frame = Pose(outer @ turn.reshape(3, 3), place.xpos + outer @ pos)
    geoms = np.flatnonzero(model.body_weldid[model.geom_bodyid] == model.body_weldid[body])
    half_x, half_y = 0.5e-3 * elastomer.width_mm, 0.5e-3 * elastomer.length_mm
    starts = [(2 * x * half_x, 2 * y * half_y, 0.0) for x in RAYS for y in RAYS]
    depths = [
        _thickness_m(model, data, geoms, frame.position_m + frame.rotation @ start, frame)
        for start in starts
    ]
    return min(depths) if any(depths) else BACKING_M


def _thickness_m(
    model: "mujoco.MjModel", data: "mujoco.MjData", geoms: np.ndarray, start_m: np.ndarray,
    frame: Pose,
) -> float:  # fmt: skip
    """Depth below a point up to which there are geoms without a gap, less CLEARANCE_M, at most
    BACKING_M."""
    into, depth = -frame.rotation[:, 2], START_M
    while depth < BACKING_M:
        point = start_m + depth * into
        ends = [
            ahead
            for geom in geoms.tolist()
            if (ahead := _hit_m(model, data, geom, point, into)) >= 0
            and _hit_m(model, data, geom, point, -into) >= 0
        ]
        if not ends:
            break
        depth += max(ends) + START_M
    return min(max(depth - START_M - CLEARANCE_M, 0.0), BACKING_M)


def _hit_m(
    model: "mujoco.MjModel", data: "mujoco.MjData", geom: int, point: np.ndarray, along: np.ndarray
) -> float:
    """Distance of a geom from a point along a ray, m; negative without a hit."""
    kind = int(model.geom_type[geom])
    if kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF):
        return mujoco.mj_rayMesh(model, data, geom, point, along)
    if kind in (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD):
        return -1.0
    pose = data.geom_xpos[geom], data.geom_xmat[geom], model.geom_size[geom]
    return mujoco.mju_rayGeom(*pose, point, along, kind)
