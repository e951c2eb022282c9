"""The gripper of examples/gripper.py: five tools, and its animation docs/pictures/gripper.gif.

    python -m benchmarks.motion.gripper

The pretrained network predicts the counts from the DIGIT's image. They are compared with those of
the CySkin in the other finger, and with those of a virtual CySkin in the same finger.
"""

import sys
from argparse import Namespace
from typing import Any

from benchmarks import ROOT
from benchmarks.evidence import Benchmark, Figure, main
from t2twin.core.files import atomic_write

BENCHMARK = Benchmark(
    module="benchmarks.motion.gripper",
    measures="A gripper with both sensors: tools held, and predicted against read counts.",
    minutes=3,
    sources=("examples", "t2twin/attachment", "sim", "translate", "primitives_cad"),
    figures=(
        Figure("tools.*.held", least=1),
        Figure("tools.*.slipped_n", "N"),
        Figure("other_finger.coverage_percent", "%", least=85),
        Figure("other_finger.rmse_counts", "counts"),
        Figure("same_finger.coverage_percent", "%", least=85),
        Figure("same_finger.rmse_counts", "counts"),
    ),
)

EXAMPLES, PICTURE = ROOT / "examples", ROOT / "docs" / "pictures" / "gripper.gif"


def measure(options: Namespace) -> dict[str, Any]:
    sys.path.insert(0, str(EXAMPLES))
    import gripper
    from gripper_figure import write_animation

    results, pages = {}, []
    for tool in gripper.GRASPS:
        results[tool], drawn = gripper.run(tool, gripper.RATE_HZ, gripper.EVERY)
        pages += drawn
    if not options.keep_nothing:
        with atomic_write(PICTURE) as temporary:
            write_animation(temporary, pages, gripper.RATE_HZ / gripper.EVERY)
    other, same = gripper.totals(results)
    return {
        "tools": {
            tool: {
                "held": result.held,
                "slipped_n": result.slipped_n,
                "other_finger": compared(result.other),
                "same_finger": compared(result.same),
            }
            for tool, result in results.items()
        },
        "other_finger": compared(other),
        "same_finger": compared(same),
    }


def compared(comparison: Any) -> dict[str, float]:
    return {
        "rmse_counts": comparison.rmse_counts,
        "coverage_percent": comparison.coverage_percent,
    }


if __name__ == "__main__":
    main(BENCHMARK)
