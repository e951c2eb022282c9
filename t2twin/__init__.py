"""t2twin: a simulated twin of touch-to-touch translation, from a DIGIT's images to CySkin counts.

Press a shape into both sensors, and predict the CySkin's counts from the DIGIT's image:

    import t2twin
    touch = t2twin.press("pliers/teeth", force_n=8, yaw_deg=30)
    counts = t2twin.load().predict(touch.image)  # the pretrained run; touch.counts is the truth

`load` without an argument loads the pretrained field run; `load("runs/small/resnet18")` loads a run
of your own. Everything in __all__ is public. A wrong argument raises T2TwinError, whose message is
one sentence. Modules are imported when one of their names is first used.
"""

import importlib
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from t2twin.adaptation.pipeline import adapt
    from t2twin.core.errors import T2TwinError
    from t2twin.primitives_cad.export import export as export_shapes
    from t2twin.primitives_cad.shape import Shape
    from t2twin.report.dataset_report import write_data_report
    from t2twin.report.run_report import write_report
    from t2twin.sim.contact.elastomer import Elastomer
    from t2twin.sim.contact.types import Contact, PressCommand
    from t2twin.sim.cyskin.layout import Layout, load_layout
    from t2twin.sim.dataset.generate import generate as make_dataset
    from t2twin.sim.dataset.import_pairs import import_pairs
    from t2twin.sim.dataset.verify import verify as verify_dataset
    from t2twin.sim.digit.calibrate.background_light import guess_light
    from t2twin.sim.digit.calibrate.calibrate import calibrate
    from t2twin.sim.touch import Touch
    from t2twin.sim.world.recipe import Recipe, load_recipe
    from t2twin.translate.evaluation.cross_dataset import evaluate_worlds
    from t2twin.translate.evaluation.evaluate import evaluate
    from t2twin.translate.inference.batch import translate_images
    from t2twin.translate.inference.load import load
    from t2twin.translate.inference.onnx_export import export_onnx
    from t2twin.translate.inference.predictor import TrainedTranslator
    from t2twin.translate.training.train import train
    from t2twin.twin import Twin, load_shape, press, shapes

_HOMES = {
    "Twin": "t2twin.twin:Twin",
    "Touch": "t2twin.sim.touch:Touch",
    "press": "t2twin.twin:press",
    "shapes": "t2twin.twin:shapes",
    "load_shape": "t2twin.twin:load_shape",
    "load": "t2twin.translate.inference.load:load",
    "Shape": "t2twin.primitives_cad.shape:Shape",
    "PressCommand": "t2twin.sim.contact.types:PressCommand",
    "Contact": "t2twin.sim.contact.types:Contact",
    "Elastomer": "t2twin.sim.contact.elastomer:Elastomer",
    "Layout": "t2twin.sim.cyskin.layout:Layout",
    "load_layout": "t2twin.sim.cyskin.layout:load_layout",
    "TrainedTranslator": "t2twin.translate.inference.predictor:TrainedTranslator",
    "T2TwinError": "t2twin.core.errors:T2TwinError",
    "export_shapes": "t2twin.primitives_cad.export:export",
    "adapt": "t2twin.adaptation.pipeline:adapt",
    "calibrate": "t2twin.sim.digit.calibrate.calibrate:calibrate",
    "guess_light": "t2twin.sim.digit.calibrate.background_light:guess_light",
    "make_dataset": "t2twin.sim.dataset.generate:generate",
    "verify_dataset": "t2twin.sim.dataset.verify:verify",
    "import_pairs": "t2twin.sim.dataset.import_pairs:import_pairs",
    "train": "t2twin.translate.training.train:train",
    "evaluate": "t2twin.translate.evaluation.evaluate:evaluate",
    "evaluate_worlds": "t2twin.translate.evaluation.cross_dataset:evaluate_worlds",
    "load_recipe": "t2twin.sim.world.recipe:load_recipe",
    "Recipe": "t2twin.sim.world.recipe:Recipe",
    "translate_images": "t2twin.translate.inference.batch:translate_images",
    "export_onnx": "t2twin.translate.inference.onnx_export:export_onnx",
    "write_report": "t2twin.report.run_report:write_report",
    "write_data_report": "t2twin.report.dataset_report:write_data_report",
}
"""Public names and where each is defined."""

__all__ = [
    "Contact",
    "Elastomer",
    "Layout",
    "PressCommand",
    "Recipe",
    "Shape",
    "T2TwinError",
    "Touch",
    "TrainedTranslator",
    "Twin",
    "adapt",
    "calibrate",
    "evaluate",
    "evaluate_worlds",
    "export_onnx",
    "export_shapes",
    "guess_light",
    "import_pairs",
    "load",
    "load_layout",
    "load_recipe",
    "load_shape",
    "make_dataset",
    "press",
    "shapes",
    "train",
    "translate_images",
    "verify_dataset",
    "write_data_report",
    "write_report",
]


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


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        from t2twin.core.renames import message

        renamed = message("name", f"t2twin.{name}")
        raise AttributeError(
            renamed or f"module 't2twin' has no attribute {name!r}; it has {', '.join(__all__)}"
        )
    module, _, attribute = _HOMES[name].partition(":")
    value = getattr(importlib.import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
