"""`make bench`: every measurement in turn; fails where one misses a limit of its own."""

import runpy
import sys

MODULES = ("press", "dome", "digit_render", "phi", "gain", "latency", "training")

failed = []
for module in MODULES:
    print(f"== {module}", flush=True)
    sys.argv = [module]
    try:
        runpy.run_module(f"benchmarks.{module}", run_name="__main__")
    except SystemExit as stop:
        if stop.code:
            failed.append(module)
if failed:
    sys.exit(f"over their limits: {', '.join(failed)}")
