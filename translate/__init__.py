"""phi, the translators, their training and their evaluation.

torch and ONNX Runtime read the following settings when they are first imported. Variables that are
set already keep their value.
"""

import os

from t2twin.core.cache_dir import cache_dir

# Waiting threads of torch otherwise spin. On a machine with other load, two threads are then up to
# eight times slower than one (measured).
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# ONNX Runtime otherwise sends usage data and stores a device identifier in the user's cache.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
# The default folder of torch's compiler is a temporary one named after the user, which requires
# that the user has a name.
if (_home := cache_dir()) is not None:
    os.environ.setdefault("TORCHINDUCTOR_CACHE_DIR", str(_home / "torch"))
