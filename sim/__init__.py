"""The simulated bench: soft contact, the DIGIT's picture, the CySkin's counts, the protocol
and the paired dataset."""
