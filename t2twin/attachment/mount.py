"""Attaches a sensor to a MuJoCo model, whose lengths are in meters.

The sensor's body is welded to its mount; MuJoCo excludes contacts between welded bodies. The
sensor's collision geom reaches behind its base, as far as its mount.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from t2twin.attachment.contacts import BODY, FRAME, SURFACE, Pose
from t2twin.attachment.geometry import Geometry
from t2twin.attachment.sensor import AttachedSensor
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import MAX_FRICTION, Elastomer, MountTable
from t2twin.sim.contact.layer import prepare_shear
from t2twin.sim.contact.mujoco_contact import prepare_models
from t2twin.sim.optical.markers import Markers
from t2twin.sim.sensors.files import Sensor, load_sensor
from t2twin.sim.taxels.layout import Layout

CONDIM = 4  # dimensions of MuJoCo's contacts: a soft surface also resists turning about the normal
# Contact parameters of a sensor's geom, see MuJoCo's manual, Modeling, Solver parameters (assumed:
# a finger of 50 g yields by 0.03 mm at 10 N, less than the layer). MuJoCo raises the time constant
# of 0.004 s to two time steps.
SOLREF, SOLIMP = (0.004, 1.0), (0.9, 0.99, 0.001, 0.5, 2.0)
OWN_SOLMIX = 1e6  # weight of the contact parameters of a sensor's geom; others have 1
# Distance of the vertices of a dome, mm. Its facets are within 0.006 mm of a dome whose radius is
# 21 mm.
MESH_PITCH_MM = 1.0
# Largest depth where the spec does not compile yet, m (assumed: most fingers are thicker).
UNKNOWN_M = 0.008
RAYS = (-0.25, 0.0, 0.25)  # places of rays along both sides of the pad, in shares of its sides
# Distance of the geom from the mount's far side, m (assumed: more than bodies at rest there sink in
# with MuJoCo's default contact).
CLEARANCE_M = 1e-3
# Distance of two bases below which they are in one place, m (assumed: rounding).
SAME_PLACE_M = 1e-6
START_M = 1e-4  # depth below the base at which a ray starts, m (assumed)


def attach(
    spec: "mujoco.MjSpec",
    *,
    sensor: str | Path,
    site: str | None = None,
    body: str | None = None,
    pos: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    quat: Sequence[float] | np.ndarray = (1.0, 0.0, 0.0, 0.0),
    name: str | None = None,
    optics: str | Path | None = None,
    layout: str | Path | Layout | None = None,
    imperfections: str | None = None,
    markers: Markers | bool | None = None,
    friction: float | None = None,
    geometry: Geometry = "collision",
    rate_hz: float | None = None,
    seed: int | None = None,
) -> AttachedSensor:
    """Add a sensor to a MuJoCo model before it is compiled; the spec must be in meters.

    sensor: name of a bundled sensor (`t2twin.sensors()`), or a sensor file, whose table [mount]
    gives the mass, the color, and the largest depth of the geom. site, body: name of the site or
    body that it is mounted on; body "world" is the world. pos, quat: pose of the center of the
    sensor's base relative to that, m. The base is the bonded side of the elastomer. The pose's z
    axis is the sensor's outward normal; its x axis is to the right in the image of a gel camera.
    name: of the elements; None for the sensor's name, with a number from the second one on. The
    model gets the body NAME/body, the geom and mesh NAME/surface, and the site NAME/frame at the
    apex of the undeformed surface. The geom reaches behind the base, as far as the geoms there.
    optics, markers, layout, imperfections: as for `Twin`. friction: coefficient of the sensor's
    geom; None for MuJoCo's default. MuJoCo uses the larger one of both geoms in a contact.
    geometry: geoms of the touching bodies that are pressed into the sensor: "collision", or
    "visual" for those without collision where there are any. rate_hz: readings per second of
    simulated time; None for one whenever the state has changed. seed: of the camera noise or the
    array's imperfections; None for neither.
    Raises T2TwinError for invalid arguments, and for names that do not exist or clash.
    """
    if not isinstance(spec, mujoco.MjSpec):
        raise T2TwinError(f"spec is {arguments.describe(spec)}; expected a mujoco.MjSpec")
    options: dict[str, Any] = {"optics": optics, "layout": layout}
    options |= {"imperfections": imperfections, "markers": markers}
    device = load_sensor(sensor)
    allowed = [option for option in options if option in device.OPTIONS]
    for option, value in options.items():
        if value is not None and option not in allowed:
            names = " and ".join(allowed)
            raise T2TwinError(f"{option} is given, but {device.name} lacks it; it has {names}")
    if imperfections is not None and seed is None:
        raise T2TwinError("imperfections have no effect without a seed; give both or none")
    device = device.with_options(options)
    mounted = AttachedSensor(_free_name(spec, name, sensor), device, geometry, rate_hz, seed)
    pose = arguments.vector(pos, "pos", 3), _unit(arguments.vector(quat, "quat", 4))
    place = _place(spec, site, body)
    depth_m = _backing_m(spec, place.name, site is not None, *pose, device)
    own = _own_spec(device.mount, mounted.elastomer, friction, depth_m, *pose)
    on = {"site": place} if body is None else {"frame": place.add_frame()}
    spec.attach(own, prefix=f"{mounted.name}/", **on)
    prepare_models()
    prepare_shear(mounted.elastomer, device.pitch_mm)
    return mounted


def _unit(quat: np.ndarray) -> np.ndarray:
    """A quaternion of length 1."""
    if not quat.any():
        raise T2TwinError("quat is 0 0 0 0; expected a quaternion that is not zero")
    quat = quat / np.abs(quat).max()
    return quat / np.linalg.norm(quat)


def _place(
    spec: "mujoco.MjSpec", site: str | None, body: str | None
) -> "mujoco.MjsSite | mujoco.MjsBody":
    """The site or the body to mount on."""
    if (site is None) == (body is None):
        given = "both given" if site is not None else "both missing"
        raise T2TwinError(f"site and body are {given}; expected one of them")
    kind, name = ("site", site) if body is None else ("body", body)
    found = getattr(spec, kind)(arguments.text(name, kind))
    if found is None:
        there = spec.sites if body is None else spec.bodies
        names = ", ".join(each.name for each in there if each.name) or "none"
        raise T2TwinError(f"the model has no {kind} {name!r}; expected one of {names}")
    if body is None and np.isfinite(found.fromto[0]):
        raise T2TwinError(f"site {site} has fromto; expected a site with a position")
    return found


def _own_spec(
    mount: MountTable,
    elastomer: Elastomer,
    friction: float | None,
    depth_m: float,
    pos: np.ndarray,
    quat: np.ndarray,
) -> "mujoco.MjSpec":
    """The sensor as a spec of its own, so that defaults of the model do not apply to it."""
    spec, thickness_m = mujoco.MjSpec(), 1e-3 * elastomer.thickness_mm
    body = spec.worldbody.add_body(name=BODY, pos=pos, quat=quat)
    geom = body.add_geom(name=SURFACE, mass=mount.mass_kg, rgba=mount.color, condim=CONDIM)
    geom.solref, geom.solimp, geom.solmix = SOLREF, SOLIMP, OWN_SOLMIX
    half_m = 0.5e-3 * np.array([elastomer.width_mm, elastomer.length_mm])
    if not elastomer.is_flat:
        mesh = spec.add_mesh(name=SURFACE, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX)
        mesh.uservert = _dome_vertices_m(elastomer, depth_m).ravel()
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, SURFACE
    else:
        geom.type = mujoco.mjtGeom.mjGEOM_BOX
        geom.size = [*half_m, (thickness_m + depth_m) / 2]
        geom.pos = [0.0, 0.0, (thickness_m - depth_m) / 2]
    if friction is not None:
        geom.friction[0] = arguments.number(friction, "friction", 0.0, MAX_FRICTION)
    body.add_site(name=FRAME, pos=[0.0, 0.0, thickness_m])
    return spec


def _dome_vertices_m(elastomer: Elastomer, depth_m: float) -> np.ndarray:
    """(n, 3) vertices whose convex hull is the elastomer and its backing, m; z is 0 at the base."""
    sides = np.array([elastomer.width_mm, elastomer.length_mm])
    # an even number, so that the apex is in a facet: a ball rests on the flat facet
    points = 2 * np.ceil(sides / MESH_PITCH_MM / 2).astype(int)
    x, y = (np.linspace(-side / 2, side / 2, n) for side, n in zip(sides, points, strict=True))
    x, y = np.meshgrid(x, y)
    top = np.stack([x, y, elastomer.thickness_at_mm(x, y)], axis=-1).reshape(-1, 3)
    base = top.reshape(*x.shape, 3)[:: len(y) - 1, :: x.shape[1] - 1].reshape(-1, 3).copy()
    base[:, 2] = -1e3 * depth_m
    return 1e-3 * np.concatenate([top, base])


def _free_name(spec: "mujoco.MjSpec", name: str | None, sensor: str | Path) -> str:
    """The given name, or the first free one."""

    def is_used(name: str) -> bool:
        places = ((spec.body, BODY), (spec.geom, SURFACE), (spec.mesh, SURFACE), (spec.site, FRAME))
        return any(find(f"{name}/{part}") is not None for find, part in places)

    if name is None:
        own = str(sensor)
        own = Path(own).stem if own.endswith(".toml") else own
        names = (own if n == 1 else f"{own}-{n}" for n in count(1))
        return next(each for each in names if not is_used(each))
    if not arguments.text(name, "name"):
        raise T2TwinError("name is empty; expected a text of at least one character")
    if is_used(name):
        raise T2TwinError(f"the model already has elements named {name}/...; take another name")
    return name


def _backing_m(
    spec: "mujoco.MjSpec", parent: str, is_site: bool, pos: np.ndarray, quat: np.ndarray,
    device: Sensor,
) -> float:  # fmt: skip
    """Depth of the geom behind a sensor's base, m: the least thickness of the geoms there."""
    # 0 for a mount that is narrower than half the pad; the sensor's own depth without any geom.
    elastomer, deepest_m = device.elastomer, 1e-3 * device.mount.depth_mm
    try:
        model = spec.copy().compile()
    except (ValueError, mujoco.FatalError):
        return min(UNKNOWN_M, deepest_m)
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
    _check_free(model, data, frame.position_m)
    geoms = np.flatnonzero(model.body_weldid[model.geom_bodyid] == model.body_weldid[body])
    width_m, length_m = 1e-3 * elastomer.width_mm, 1e-3 * elastomer.length_mm
    starts = [
        frame.position_m + frame.rotation @ (x * width_m, y * length_m, 0.0)
        for x in RAYS
        for y in RAYS
    ]
    depths = [_thickness_m(model, data, geoms, each, frame, deepest_m) for each in starts]
    return min(depths) if any(depths) else deepest_m


def _check_free(model: "mujoco.MjModel", data: "mujoco.MjData", position_m: np.ndarray) -> None:
    """Refuses a place where another sensor is mounted."""
    for body in range(model.nbody):
        name, _, part = model.body(body).name.rpartition("/")
        frame = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{name}/{FRAME}")
        is_sensor = part == BODY and frame >= 0 and model.site_bodyid[frame] == body
        if is_sensor and np.allclose(data.xpos[body], position_m, rtol=0.0, atol=SAME_PLACE_M):
            raise T2TwinError(
                f"the sensor {name} is already mounted there, and two sensors cannot share a "
                "contact; take another site, body or pos"
            )


def _thickness_m(
    model: "mujoco.MjModel", data: "mujoco.MjData", geoms: np.ndarray, start_m: np.ndarray,
    frame: Pose, deepest_m: float,
) -> float:  # fmt: skip
    """Depth below a point up to which there are geoms without a gap, less CLEARANCE_M, m."""
    into, depth = -frame.rotation[:, 2], START_M
    while depth < deepest_m:
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
    return min(max(depth - START_M - CLEARANCE_M, 0.0), deepest_m)


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
