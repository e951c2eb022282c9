"""t2twin doctor: checks this machine, one line for each check."""

import os
import platform
import shutil
import sys
from importlib.util import find_spec

from t2twin.core.errors import how_to_install
from t2twin.core.machine import NOT_INSTALLED, cores, installed_version

PACKAGES = (
    "cadquery", "mujoco", "msgspec", "numba", "numpy", "scipy", "trimesh", "pyrender", "torch",
    "pyarrow", "scikit-image", "safetensors",
)  # fmt: skip
EXTRAS = {"cluster": "distributed", "live": "cv2", "onnx": "onnxruntime", "studio": "viser"}
"""A module of each extra of the package."""

LIBRARY = "libgl1"  # Debian's package of the library that the CAD kernel needs
VOLUME_ERROR_MM3 = 1e-6  # tolerated error of the volume of a box
MEMORY_GIB = 4  # memory that every command fits into
DISK_GIB = 4  # free disk space for the dataset of scale paper and its runs
STEPS = 200  # after which a pin on its spring is at rest (assumed; a press takes a few)
SPRING_ERROR_MM = 1e-2  # tolerated error of that pin's depth


def doctor() -> None:
    """Check this machine: Python, packages, CAD kernel, MuJoCo, headless OpenGL, memory, disk."""
    failed = 0
    for check in (_packages, _extras, _solids, _contact, _rendering, _memory, _disk, _cache):
        name = check.__name__.removeprefix("_")
        try:
            print(f"ok    {name:10} {check()}")
        except Exception as error:  # the other checks run in any case
            failed = 1
            print(f"FAIL  {name:10} {error}")
    sys.exit(failed)


def _packages() -> str:
    versions = {name: installed_version(name) for name in PACKAGES}
    if missing := [name for name in PACKAGES if versions[name] == NOT_INSTALLED]:
        raise RuntimeError(
            f"not installed: {', '.join(missing)}; install t2twin again with pip, without --no-deps"
        )
    python = f"Python {platform.python_version()} on {platform.system()}, {cores()} cores"
    return ", ".join([python, *(f"{name} {version}" for name, version in versions.items())])


def _extras() -> str:
    """The optional packages, whose absence is no failure."""
    missing = [extra for extra, module in EXTRAS.items() if find_spec(module) is None]
    if not missing:
        return f"{', '.join(EXTRAS)} are installed"
    return f"not installed: {', '.join(missing)}; {how_to_install(*missing)}"


def _solids() -> str:
    try:
        import cadquery
    except ImportError as error:
        raise RuntimeError(f"{error}; on Debian: apt-get install {LIBRARY}") from error
    volume = cadquery.Workplane().box(1, 2, 3).val().Volume()  # pyright: ignore
    if abs(volume - 6.0) > VOLUME_ERROR_MM3:
        raise RuntimeError(f"a solid of 6 mm3 has {volume:g} mm3")
    return "the CAD kernel makes a solid"


def _contact() -> str:
    import numpy as np

    from t2twin.sim.contact.mujoco_contact import borrowed_pins

    depth_mm, none = 0.0, np.zeros(1)
    with borrowed_pins(1) as model:
        for _ in range(STEPS):
            depth_mm, _ = model.step(none, depth_mm, 1.0, none, np.ones(1))
    if abs(depth_mm - 1.0) > SPRING_ERROR_MM:
        raise RuntimeError(f"a unit spring gave {depth_mm:g} mm under a unit force instead of 1 mm")
    return "a MuJoCo spring under a unit force gives a unit of depth"


def _rendering() -> str:
    if sys.platform == "darwin":
        return "not on macOS, which has no EGL; only the renderer pyrender needs it"
    import numpy as np

    from t2twin.sim.optical.camera import optical_grid
    from t2twin.sim.optical.pyrender_renderer import ReferenceRenderer
    from t2twin.sim.sensors.pair import SensorPair

    sensor = SensorPair().camera
    x, y = optical_grid(sensor.own_gel)
    leds, ambient = sensor.spec.light.leds, sensor.spec.light.ambient
    with ReferenceRenderer(leds, ambient, sensor.camera, sensor.own_gel) as renderer:
        image = renderer.render(np.zeros((y.size, x.size)))
    if image.max() == 0:
        raise RuntimeError("pyrender rendered a black image; the OpenGL driver is not usable")
    return "pyrender renders the gel without a display (EGL)"


def _memory() -> str:
    if "SC_PHYS_PAGES" not in getattr(os, "sysconf_names", ()):
        return "unknown"
    gib = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    if gib < MEMORY_GIB:
        raise RuntimeError(f"{gib:.1f} GiB; at least {MEMORY_GIB} GiB are needed")
    return f"{gib:.0f} GiB"


def _disk() -> str:
    gib = shutil.disk_usage(".").free / 2**30
    if gib < DISK_GIB:
        raise RuntimeError(f"{gib:.1f} GiB free here; scale paper needs {DISK_GIB} GiB")
    return f"{gib:.0f} GiB free here"


def _cache() -> str:
    from t2twin.core.cache_dir import VARIABLE, cache_dir

    folder = cache_dir()
    if folder is None:
        return f"none: no folder is writable; set {VARIABLE} to a writable one"
    return f"{folder} (shapes, compiled code)"
