"""The simulated bench: soft contact, the DIGIT's image, the CySkin's counts, the protocol
and the paired dataset."""
