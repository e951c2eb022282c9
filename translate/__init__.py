"""phi, the two translators, their training and evaluation."""

import os

# torch's threads wait by spinning, which on a machine that does anything else beside makes two
# threads up to eight times slower than one (measured). Read when torch is first imported.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

# onnxruntime sends usage data and leaves a device's id in the user's cache, unless this is set
# before it is imported.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
