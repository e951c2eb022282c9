"""The simulated bench: soft contact, images of gel cameras, counts of taxel arrays, the protocol
and the paired dataset."""
