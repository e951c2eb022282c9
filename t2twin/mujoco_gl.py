"""MUJOCO_GL=egl in an environment with pyrender; this module is an import finder.

pyrender requires PyOpenGL 3.1.0. Its EGL module lacks a type that MuJoCo needs, so that the import
of MuJoCo would fail with an AttributeError, even where nothing is rendered. And it declares the
prefix of EGL's extensions as text instead of bytes, which pyrender could not be imported after.
"""

import ctypes
import importlib
from typing import Any

EGL_MODULE = "mujoco.egl.egl_ext"
"""The module of MuJoCo that needs the type. Before it is imported, MuJoCo selects the platform of
PyOpenGL."""


def find_spec(name: str, path: object = None, target: object = None) -> None:
    """Finds nothing, but repairs PyOpenGL before EGL_MODULE is imported.

    Raises ImportError without an EGL library; MuJoCo can then be used without rendering.
    """
    if name != EGL_MODULE:
        return
    try:
        egl: Any = importlib.import_module("OpenGL.EGL")
    except AttributeError as error:  # PyOpenGL searches a function in no library
        raise ImportError(f"there is no EGL library ({error})") from error
    if hasattr(egl, "EGLDeviceEXT"):
        return
    egl.EGLDeviceEXT = ctypes.c_void_p
    querier: Any = importlib.import_module("OpenGL.raw.EGL._types").EGLQuerier
    querier.prefix, querier.version_prefix = b"EGL_", b"EGL_VERSION_EGL_"
