from functools import lru_cache
from pathlib import Path

import pytest

from t2twin.primitives_cad import catalogue


def pytest_addoption(parser):
    parser.addoption(
        "--real-digit",
        metavar="DIR",
        help="folder with background.png and press_*.png of a real DIGIT and a 4.70 mm ball",
    )


@pytest.fixture(scope="session")
def real_digit(request):
    """The folder of a real DIGIT's frames; skips without it."""
    folder = request.config.getoption("--real-digit")
    if folder is None:
        pytest.skip("needs a real DIGIT's frames: --real-digit DIR")
    return Path(folder)


@pytest.fixture(scope="session")
def shape_cache(tmp_path_factory):
    """Where prepared shapes are kept: each is made once for the whole session."""
    return tmp_path_factory.mktemp("shapes")


@pytest.fixture(scope="session")
def shapes(shape_cache):
    """Catalogue shapes by name."""
    return lru_cache(maxsize=None)(lambda name: catalogue.load(name, shape_cache))
