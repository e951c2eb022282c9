"""t2twin: a simulated twin of touch-to-touch translation, from a DIGIT's images to CySkin counts.

Press a shape into both sensors, and predict the CySkin's counts from the DIGIT's image:

    import t2twin
    touch = t2twin.press("pliers/teeth", force_n=8, yaw_deg=30)
    counts = t2twin.load().predict(touch.image)  # the pretrained run; touch.counts is the truth

`load` without an argument loads the pretrained field run; `load("runs/small/resnet18")` loads a run
of your own. Everything in __init__.pyi is public. A wrong argument raises T2TwinError, whose
message is one sentence. Modules are imported when one of their names is first used.
"""

import sys
from typing import Any

import lazy_loader

from t2twin.mujoco_gl import EglRepair

_imported, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


class _RenamedModules:
    """An import finder, the last one, that names the new path of a module of version 0.2.

    Its error has no `name`: `from t2twin.translate import predict` would hide it.
    """

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        if name.startswith(f"{__name__}."):
            from t2twin.core.renames import message

            if sentence := message("import", name):
                raise ModuleNotFoundError(sentence)


sys.meta_path.append(_RenamedModules)
sys.meta_path.insert(0, EglRepair)


def __getattr__(name: str) -> Any:
    if name in __all__:
        return _imported(name)
    from t2twin.core.renames import message

    renamed = message("name", f"t2twin.{name}")
    raise AttributeError(
        renamed or f"module 't2twin' has no attribute {name!r}; it has {', '.join(__all__)}"
    )
