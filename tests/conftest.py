from functools import lru_cache

import pytest

from primitives_cad import catalogue


@pytest.fixture(scope="session")
def shapes(tmp_path_factory):
    """Catalogue shapes by name, made once for the whole session."""
    cache = tmp_path_factory.mktemp("shapes")
    return lru_cache(maxsize=None)(lambda name: catalogue.load(name, cache))
