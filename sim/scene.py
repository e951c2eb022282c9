"""A solved press as a MuJoCo scene for viewing: the model of `contact.mujoco_contact`, mm and N.

Its keyframe `rest` is the equilibrium. The force is an actuator and can be changed; the springs
then respond without the layer's coupling."""

from html import escape
from pathlib import Path

import numpy as np

from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.mujoco_contact import BALL_MM, PIN_MASS, SHAPE_MASS
from t2twin.sim.contact.types import Contact, PinState

STEP_S = 0.02  # time step of the scene, s
SINK_MM = 0.05  # of the rendered surface below the pins' dots, so that both are visible
MAX_FORCE = 4.0  # largest force of the actuator over the commanded one
MAX_FACES = 200_000  # limit of MuJoCo on the triangles of a mesh
# Colors of pins without force and with the largest force.
PALE, DEEP = np.array([0.75, 0.8, 0.85]), np.array([0.85, 0.1, 0.1])


def scene(contact: Contact, mesh_file: str | None) -> str:
    """The scene as MJCF text.

    mesh_file: name of the shape's STL file in the scene's folder, or None for no mesh.
    """
    command, elastomer, state = contact.command, contact.elastomer, contact.pins
    pins, over, pairs = _pin_elements(state)
    field, surface = _surface_elements(contact)
    mesh = solid = ""
    if mesh_file is not None:
        quaternion, (x, y, z) = contact.shape_pose
        place = f'pos="{x:.6g} {y:.6g} {z + contact.depth_mm:.6g}"'
        quat = " ".join(f"{value:.9g}" for value in quaternion)
        mesh = f'<mesh name="solid" file="{mesh_file}" inertia="shell"/>'
        solid = f'<geom class="solid" {place} quat="{quat}"/>'
    mass = SHAPE_MASS * np.median(state.stiffness_n_per_mm) * STEP_S**2
    heights = " ".join(f"{-depth:.9g}" for depth in state.deflection_mm)
    return f"""<mujoco model="{escape(f"{contact.shape.name} on the {elastomer.name}")}">
  <compiler angle="radian"/>
  <option timestep="{STEP_S:g}" integrator="discrete" solver="Newton" gravity="0 0 0"
    tolerance="1e-10"><flag refsafe="disable" island="disable"/></option>
  <size memory="{max(16, state.x_mm.size // 16)}M"/>
  <statistic center="{command.x_mm:g} {command.y_mm:g} 0" extent="15"/>
  <visual><headlight ambient="0.45 0.45 0.45" diffuse="0.5 0.5 0.5"/></visual>
  <default>
    <geom contype="0" conaffinity="0"/>
    <pair condim="1" solref="{0.001 * STEP_S:g} 1" solimp="0.9999 0.9999 0.001 0.5 2"/>
    <default class="pin"><joint type="slide" axis="0 0 1"/></default>
    <default class="ball"><geom type="sphere" size="{BALL_MM:g}" group="3"/></default>
    <default class="dot"><geom type="sphere" mass="0"/></default>
    <default class="solid">
      <geom type="mesh" mesh="solid" mass="0" group="1" rgba="0.4 0.45 0.5 0.35"/>
    </default>
  </default>
  <asset>
    {mesh}
    {field}
    <texture name="sky" type="skybox" builtin="flat" rgb1="0.93 0.94 0.96" width="32" height="192"/>
  </asset>
  <worldbody>
    {surface}
    <geom name="base" type="box" pos="0 0 {-elastomer.thickness_mm - 0.5:g}"
      size="{elastomer.width_mm / 2:g} {elastomer.length_mm / 2:g} 0.5" rgba="0.3 0.3 0.35 1"/>
    <body name="shape">
      <inertial pos="0 0 0" mass="{mass:.6g}" diaginertia="1 1 1"/>
      <joint name="down" type="slide" axis="0 0 1"/>
      {solid}
      {over}
    </body>
    {pins}
  </worldbody>
  <contact>{pairs}</contact>
  <actuator>
    <motor name="force_n" joint="down" ctrlrange="{-MAX_FORCE * command.force_n:g} 0"/>
  </actuator>
  <keyframe>
    <key name="rest" qpos="{-contact.depth_mm:.9g} {heights}" ctrl="{-command.force_n:g}"/>
  </keyframe>
</mujoco>
"""


def _surface_elements(contact: Contact) -> tuple[str, str]:
    """The height field of the whole pad's surface, and its geom just below the pins, as MJCF."""
    x, y = contact.x_mm, contact.y_mm
    surface = contact.elastomer.rest_surface_mm(*np.meshgrid(x, y)) - contact.surface_mm
    low, high = float(surface.min()), float(surface.max())
    # Rows of MJCF text run from large to small y.
    elevation = " ".join(f"{height:.4f}" for height in surface[::-1].ravel())
    return (
        f'<hfield name="surface" nrow="{y.size}" ncol="{x.size}" elevation="{elevation}" '
        f'size="{x[-1]:g} {y[-1]:g} {max(high - low, 1e-3):.6g} 0.05"/>',
        f'<geom name="surface" type="hfield" hfield="surface" pos="0 0 {low - SINK_MM:.6g}" '
        'rgba="0.85 0.75 0.6 0.6" group="1"/>',
    )


def _pin_elements(state: PinState) -> tuple[str, str, str]:
    """The pins' bodies, the shape's balls above them, and the contact pairs, as MJCF."""
    stiffness = state.stiffness_n_per_mm
    forces = stiffness * np.maximum(state.deflection_mm - state.spring_rest_mm, 0.0)
    colors = PALE + (DEEP - PALE) * (forces / forces.max())[:, None]
    pins, over, pairs = [], [], []
    for i in range(state.x_mm.size):
        x, y, z = state.x_mm[i], state.y_mm[i], state.rest_mm[i]
        red, green, blue = colors[i]
        pins.append(
            f'<body name="pin{i}" pos="{x:.6g} {y:.6g} {z:.9g}">'
            f'<joint class="pin" stiffness="{stiffness[i]:.9g}" '
            f'springref="{-state.spring_rest_mm[i]:.9g}"/>'
            f'<geom class="ball" name="tip{i}" pos="0 0 {-BALL_MM:g}" '
            f'mass="{PIN_MASS * stiffness[i] * STEP_S**2:.6g}"/>'
            f'<geom class="dot" size="{state.side_mm[i] / 2:g}" '
            f'rgba="{red:.3f} {green:.3f} {blue:.3f} 1"/></body>'
        )
        over.append(
            f'<geom class="ball" name="over{i}" '
            f'pos="{x:.6g} {y:.6g} {z + state.gap_mm[i] + BALL_MM:.9g}" mass="0"/>'
        )
        pairs.append(f'<pair geom1="over{i}" geom2="tip{i}"/>')
    return "".join(pins), "".join(over), "".join(pairs)


def mesh_name(shape: Shape) -> str | None:
    """Name of the STL file for a scene; None for meshes that MuJoCo cannot read."""
    return "shape.stl" if 0 < len(shape.triangles[1]) <= MAX_FACES else None


def view(path: Path) -> None:
    """Open a scene at its keyframe in MuJoCo's viewer; returns when that is closed."""
    import mujoco
    import mujoco.viewer

    model = mujoco.MjModel.from_xml_path(str(path))  # pyright: ignore[reportAttributeAccessIssue]
    data = mujoco.MjData(model)  # pyright: ignore[reportAttributeAccessIssue]
    mujoco.mj_resetDataKeyframe(model, data, 0)  # pyright: ignore[reportAttributeAccessIssue]
    mujoco.viewer.launch(model, data)
