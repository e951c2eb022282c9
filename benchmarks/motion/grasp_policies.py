"""Grasps of random objects in examples/gymnasium_grasp.py, with and without reaction to slip.

python -m benchmarks.motion.grasp_policies
"""

import sys
from argparse import Namespace
from typing import Any

from benchmarks import ROOT
from benchmarks.evidence import Argument, Benchmark, Figure, main

OBJECTS = 200

BENCHMARK = Benchmark(
    module="benchmarks.motion.grasp_policies",
    measures="Share of random objects that a gripper holds, with and without reaction to slip.",
    minutes=10,
    sources=("examples", "t2twin/attachment", "sim"),
    figures=(
        Figure("fixed.success_percent", "%"),
        Figure("reacting.success_percent", "%"),
        Figure("difference_points", "points", least=30),
    ),
    arguments=(Argument("--objects", "number of random objects", int, OBJECTS, partial=True),),
)


def measure(options: Namespace) -> dict[str, Any]:
    sys.path.insert(0, str(ROOT / "examples"))
    from gymnasium_grasp import scores

    content: dict[str, Any] = {}
    for name, found in zip(("fixed", "reacting"), scores(options.objects), strict=True):
        content[name] = {
            "held": found.held,
            "objects": found.objects,
            "success_percent": found.percent,
            "interval_percent": list(found.interval_percent),
            "grip_n": found.grip_n,
        }
    content["difference_points"] = (
        content["reacting"]["success_percent"] - content["fixed"]["success_percent"]
    )
    return content


if __name__ == "__main__":
    main(BENCHMARK)
