from functools import lru_cache

import pytest

from primitives_cad import catalogue


@pytest.fixture(scope="session")
def shape_cache(tmp_path_factory):
    """Where prepared shapes are kept: each is made once for the whole session."""
    return tmp_path_factory.mktemp("shapes")


@pytest.fixture(scope="session")
def shapes(shape_cache):
    """Catalogue shapes by name."""
    return lru_cache(maxsize=None)(lambda name: catalogue.load(name, shape_cache))
