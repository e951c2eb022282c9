"""t2twin: a simulated twin of touch-to-touch translation between two tactile sensors.

Press a shape into both sensors, and predict the counts from the image:

    import t2twin
    touch = t2twin.press("pliers/teeth", force_n=8, yaw_deg=30)
    counts = t2twin.load().predict(touch.image)  # the pretrained run; touch.counts is the truth

`load` without an argument loads the pretrained field run; `load("runs/small/resnet18")` loads a run
of your own. Everything in __init__.pyi is public. A wrong argument raises T2TwinError, whose
message is one sentence. Modules are imported when one of their names is first used.
"""

import sys

import lazy_loader

from t2twin import mujoco_gl

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

sys.meta_path.insert(0, mujoco_gl)
