"""phi, the two translators, their training and evaluation."""

import os

from t2twin.core.cache_dir import cache_dir

# torch's threads wait by spinning, which on a machine that does anything else beside makes two
# threads up to eight times slower than one (measured). Read when torch is first imported.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

# onnxruntime sends usage data and leaves a device's id in the user's cache, unless this is set
# before it is imported.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

# torch's compiler, which nothing here uses, makes a folder when an optimizer is first made: in the
# temporary one, under the user's name, which not every user has.
_home = cache_dir()
if _home is not None:
    os.environ.setdefault("TORCHINDUCTOR_CACHE_DIR", str(_home / "torch"))
