"""`make bench`: every measurement, one after the other."""

import runpy
import sys

MODULES = ("press", "digit_render", "gain")

for module in MODULES:
    print(f"== {module}")
    sys.argv = [module]
    runpy.run_module(f"benchmarks.{module}", run_name="__main__")
