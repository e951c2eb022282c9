"""Attaches a sensor to a MuJoCo model, whose lengths are in meters.

The sensor's body is welded to its mount. MuJoCo excludes contacts between bodies that are welded
together. The sensor's collision geom reaches behind its base, as far as its mount.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterable, Sequence
from itertools import count
from pathlib import Path

import mujoco
import numpy as np

from t2twin.attachment.contacts import BODY, FRAME, SURFACE, Pose
from t2twin.attachment.geometry import Geometry
from t2twin.attachment.sensor import AttachedSensor, SensorName
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.renamed import new_keywords
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.sliding import MAX_FRICTION
from t2twin.sim.optical.markers import Markers, as_markers
from t2twin.sim.sensors import CySkin, Digit
from t2twin.sim.taxels.layout import DEFAULT_LAYOUT

MASS_KG = {"digit": 0.02, "cyskin": 0.0034}
"""Masses of the sensors, kg. DIGIT: Lambeta et al., DIGIT, IEEE RA-L 2020. CySkin: its cover of
Ecoflex, 1.04 g/cm3 (maker's data sheet)."""

COLOR = {"digit": (0.85, 0.75, 0.6, 1.0), "cyskin": (0.25, 0.3, 0.35, 1.0)}
"""Colors of the sensors, RGBA."""

CONDIM = 4
"""Dimensions of MuJoCo's contacts: a soft surface also resists turning about the normal."""

SOLREF, SOLIMP = (0.004, 1.0), (0.9, 0.99, 0.001, 0.5, 2.0)
"""Contact parameters of a sensor's geom, see MuJoCo's manual, Modeling, Solver parameters (assumed:
a finger of 50 g yields by 0.03 mm at 10 N, less than the layer). MuJoCo raises the time constant of
0.004 s to two time steps."""

OWN_SOLMIX = 1e6
"""Weight of the contact parameters of a sensor's geom; others have 1."""

MESH_PITCH_MM = 1.0
"""Distance of the vertices of a dome, mm. Its facets are within 0.006 mm of the dome."""

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


@new_keywords
def attach(
    spec: "mujoco.MjSpec",
    *,
    sensor: SensorName,
    site: str | None = None,
    body: str | None = None,
    pos: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    quat: Sequence[float] | np.ndarray = (1.0, 0.0, 0.0, 0.0),
    name: str | None = None,
    optics: str | Path | None = None,
    layout: str | Path | None = None,
    imperfections: str | None = None,
    markers: Markers | bool | None = None,
    friction: float | None = None,
    geometry: Geometry = "collision",
    rate_hz: float | None = None,
    seed: int | None = None,
) -> AttachedSensor:
    """Add a sensor to a MuJoCo model before it is compiled; the spec must be in meters.

    sensor: "digit" or "cyskin". site, body: name of the site or body it is mounted on; body "world"
    is the world. pos, quat: pose of the sensor's base relative to that, m. The base is the bonded
    side of the gel or cover, and its center is at the pose. The pose's z axis is the sensor's
    outward normal. Its x axis is the sensor's x axis, to the right in the DIGIT's image.
    name: of the sensor; None for "digit" or "cyskin", with a number from the second one on. The
    model gets the body NAME/body, the geom and mesh NAME/surface, and the site NAME/frame at the
    apex of the undeformed surface. The geom reaches behind the base, as far as the geoms there, so
    that no body gets through it. optics, markers: of a DIGIT, as for `Twin`. layout,
    imperfections: of a CySkin, as for `Twin`. friction: coefficient of the sensor's geom; None for
    MuJoCo's default. MuJoCo uses the larger coefficient of both geoms in a contact.
    geometry: geoms of the touching bodies whose surfaces are pressed into the sensor: "collision",
    or "visual" for those without collision where there are any. rate_hz: readings per second of
    simulated time; None for one whenever the state has changed. seed: of the camera noise or the
    CySkin's imperfections; None for neither.
    Raises T2TwinError for invalid arguments, and for names that do not exist or clash.
    """
    if not isinstance(spec, mujoco.MjSpec):
        raise T2TwinError(
            f"spec is {arguments.describe(spec)}; expected a mujoco.MjSpec, for example of "
            "mujoco.MjSpec.from_file"
        )
    device = _device(sensor, optics, layout, imperfections, markers)
    mounted = AttachedSensor(
        name=_free_name(spec, name, sensor),
        sensor=sensor,
        device=device,
        geometry=geometry,
        rate_hz=rate_hz,
        seed=seed,
    )
    pose = arguments.vector(pos, "pos", 3), _unit(quat)
    place, prefix = _place(spec, site, body), f"{mounted.name}/"
    depth_m = _backing_m(spec, place.name, site is not None, *pose, mounted.elastomer)
    own = _own_spec(sensor, mounted.elastomer, friction, depth_m, *pose)
    if site is not None:
        spec.attach(own, site=place, prefix=prefix)
    else:
        spec.attach(own, frame=place.add_frame(), prefix=prefix)
    return mounted


def _place(
    spec: "mujoco.MjSpec", site: str | None, body: str | None
) -> "mujoco.MjsSite | mujoco.MjsBody":
    """The site or the body to mount on. Raises T2TwinError for both, none, and unknown names."""
    if (site is None) == (body is None):
        given = "both given" if site is not None else "both missing"
        raise T2TwinError(f"site and body are {given}; expected one of them")
    if site is None:
        return _named(spec.body, body, "body", spec.bodies)
    place = _named(spec.site, site, "site", spec.sites)
    if np.isfinite(place.fromto[0]):
        raise T2TwinError(f"site {site} has fromto; expected a site with a position")
    return place


def _device(
    sensor: object,
    optics: str | Path | None,
    layout: str | Path | None,
    imperfections: str | None,
    markers: Markers | bool | None,
) -> Digit | CySkin:
    """The simulated sensor. Raises T2TwinError for an argument of the other sensor."""
    arguments.choice(sensor, "sensor", ("digit", "cyskin"))
    if sensor == "cyskin":
        for value, name in ((optics, "optics"), (markers, "markers")):
            if value is not None:
                raise T2TwinError(f"{name} is given for a cyskin; only a digit has it")
        source = DEFAULT_LAYOUT if layout is None else str(arguments.path(layout, "layout"))
        flaws = CySkin.imperfections if imperfections is None else imperfections
        return CySkin(layout_source=source, imperfections=flaws)
    for value, name in ((layout, "layout"), (imperfections, "imperfections")):
        if value is not None:
            raise T2TwinError(f"{name} is given for a digit; only a cyskin has it")
    light = None if optics is None else str(arguments.path(optics, "optics"))
    return Digit(optics_file=light, markers=as_markers(markers))


def _own_spec(
    sensor: str,
    elastomer: Elastomer,
    friction: float | None,
    depth_m: float,
    pos: np.ndarray,
    quat: np.ndarray,
) -> "mujoco.MjSpec":
    """The sensor as a spec of its own, so that defaults of the model do not apply to it. depth_m:
    of its geom behind the base."""
    spec, thickness_m = mujoco.MjSpec(), 1e-3 * elastomer.thickness_mm
    body = spec.worldbody.add_body(name=BODY, pos=pos, quat=quat)
    geom = body.add_geom(name=SURFACE, mass=MASS_KG[sensor], rgba=COLOR[sensor], condim=CONDIM)
    geom.solref, geom.solimp, geom.solmix = SOLREF, SOLIMP, OWN_SOLMIX
    half_m = 0.5e-3 * np.array([elastomer.width_mm, elastomer.length_mm])
    if np.isfinite([elastomer.dome_width_radius_mm, elastomer.dome_length_radius_mm]).any():
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


def _named(find, name: object, kind: str, existing: Iterable) -> "mujoco.MjsBody | mujoco.MjsSite":
    """The site or body of a name. Raises T2TwinError for an unknown one."""
    found = find(arguments.text(name, kind))
    if found is None:
        names = [each.name for each in existing if each.name]
        there = f"expected one of {', '.join(names)}" if names else f"no {kind} of it has a name"
        raise T2TwinError(f"the model has no {kind} {name!r}; {there}")
    return found


def _free_name(spec: "mujoco.MjSpec", name: str | None, sensor: str) -> str:
    """The sensor's name, or the first free one. Raises T2TwinError for one that is in use."""

    def is_used(name: str) -> bool:
        places = ((spec.body, BODY), (spec.geom, SURFACE), (spec.mesh, SURFACE), (spec.site, FRAME))
        return any(find(f"{name}/{part}") is not None for find, part in places)

    if name is None:
        names = (sensor if n == 1 else f"{sensor}-{n}" for n in count(1))
        return next(each for each in names if not is_used(each))
    if not arguments.text(name, "name"):
        raise T2TwinError("name is empty; expected a text of at least one character")
    if is_used(name):
        raise T2TwinError(f"the model already has elements named {name}/...; take another name")
    return name


def _unit(quat: object) -> np.ndarray:
    found = arguments.vector(quat, "quat", 4)
    length = np.linalg.norm(found)
    if length == 0:
        raise T2TwinError("quat is 0 0 0 0; expected a quaternion that is not zero")
    return found / length


def _backing_m(
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
