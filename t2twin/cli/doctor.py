"""t2twin doctor"""


def doctor() -> None:
    """Check this machine: Python, packages, headless OpenGL, MuJoCo, processor and memory."""
    import sys

    from t2twin.cli.checks import run_checks

    sys.exit(0 if run_checks() else 1)
