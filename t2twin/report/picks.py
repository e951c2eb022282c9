"""Which pairs are shown: drawn at random, from every shape or family in turn."""

import numpy as np

from t2twin.report.dataset import Dataset

MOST_NAMES = 60
"""Names that are gone through in their order (assumed: as many as there are pictures of)."""


def pairs_in_turn(
    dataset: Dataset, names: np.ndarray, most: int, seed: int
) -> list[tuple[str, int]]:
    """Splits and rows: one pair of each name, then one more of each, until there are `most`.

    names: (P,) what the pairs are told apart by, such as dataset.shapes. Of more than MOST_NAMES
    the names are taken at random too.
    """
    rng = np.random.default_rng(seed)
    of_name: dict[str, list[tuple[str, int]]] = {}
    for name, place in zip(names, dataset.places, strict=True):
        of_name.setdefault(str(name), []).append(place)
    orders = [[places[i] for i in rng.permutation(len(places))] for places in of_name.values()]
    if len(orders) > MOST_NAMES:
        orders = [orders[i] for i in rng.permutation(len(orders))]
    deepest = max(len(order) for order in orders)
    in_turn = [order[turn] for turn in range(deepest) for order in orders if turn < len(order)]
    return in_turn[:most]
