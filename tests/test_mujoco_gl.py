"""MuJoCo and pyrender in one process, for each platform of OpenGL in the environment."""

import subprocess
from pathlib import Path

import pytest
from session import python

PRESS = "import t2twin; t2twin.attach; print(t2twin.press('hemisphere-4').digit.force_n)\n"

RENDER = """
import numpy as np
from t2twin.sim.optical.camera import optical_grid
from t2twin.sim.optical.pyrender_renderer import ReferenceRenderer
from t2twin.sim.sensors.files import load_sensor
sensor = load_sensor("digit")
x, y = optical_grid(sensor.elastomer)
leds, ambient = sensor.spec.light.leds, sensor.spec.light.ambient
with ReferenceRenderer(leds, ambient, sensor.camera, sensor.elastomer, 1) as renderer:
    assert renderer.render(np.zeros((y.size, x.size))).max() > 0
"""

MUJOCO = """
import t2twin, mujoco
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><light pos='0 0 3'/><geom size='.5'/></worldbody></mujoco>"
)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 60, 60) as renderer:
    renderer.update_scene(data)
    assert renderer.render().max() > 0
"""


def run(program: str, **variables: str) -> subprocess.CompletedProcess[str]:
    own = {"PYOPENGL_PLATFORM": "", "PYTHONPATH": str(Path(__file__).parents[1])}
    return python("-c", program, **(own | variables))


@pytest.mark.parametrize(
    "program", [MUJOCO + RENDER, pytest.param(RENDER + MUJOCO, marks=pytest.mark.exhaustive)]
)
def test_mujoco_and_pyrender_render_through_egl_in_either_order(program):
    done = run(program, MUJOCO_GL="egl")
    assert done.returncode == 0, done.stderr


def test_another_platform_is_named_and_a_press_needs_none():
    done = run(PRESS + RENDER, MUJOCO_GL="egl", PYOPENGL_PLATFORM="osmesa")
    assert float(done.stdout) == pytest.approx(8.0, rel=1e-3), done.stderr
    assert "T2TwinError" in done.stderr and "unset PYOPENGL_PLATFORM" in done.stderr
