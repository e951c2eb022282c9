"""What made a dataset: the paper's protocol, another world, or its owner."""

from t2twin.sim.dataset.info import DatasetInfo


def is_protocol(info: DatasetInfo) -> bool:
    """Whether it was made by the protocol of Grella et al. 2023.

    Its training and validation hold versions of the paper's primitives, its test hand tools, all
    pressed with one force. Only such a dataset is put beside the paper's figures.
    """
    return info.scale is not None


def world_of(info: DatasetInfo) -> str | None:
    """The name of what made it: a world's, or the protocol's scale; None of imported pairs."""
    return getattr(info, "world_name", None) or info.scale
