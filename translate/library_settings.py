"""Settings of torch and ONNX Runtime, which they read from the environment when first imported."""

import os

from t2twin.core.cache_dir import cache_dir


def configure_libraries() -> None:
    """Sets the environment variables of torch and ONNX Runtime that are not set.

    Modules call it before they first import torch or onnxruntime.
    """
    # Waiting threads of torch otherwise spin. On a machine with other load, two threads are then up
    # to eight times slower than one (measured).
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    # ONNX Runtime otherwise sends usage data and stores a device identifier in the user's cache.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    # The default folder of torch's compiler is a temporary one named after the user, which
    # requires that the user has a name.
    home = cache_dir()
    if home is not None:
        os.environ.setdefault("TORCHINDUCTOR_CACHE_DIR", str(home / "torch"))
