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


@pytest.fixture(scope="session", autouse=True)
def shape_cache(tmp_path_factory):
    """Where prepared shapes are kept, by commands too: each is made once for the whole session."""
    folder = tmp_path_factory.mktemp("shapes")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(catalogue, "CACHE_DIR", folder)
        yield folder


@pytest.fixture(scope="session")
def shapes(shape_cache):
    """Catalogue shapes by name."""
    return lru_cache(maxsize=None)(lambda name: catalogue.load(name, shape_cache))


@pytest.fixture(scope="module")
def runs(data_dir, tmp_path_factory):
    """Both translators, trained for three epochs on the module's own data_dir: their folders."""
    from spots import train_smoke  # imports torch, which most tests do without

    folder = tmp_path_factory.mktemp("runs")
    return [
        train_smoke(model, data_dir, folder / model, epochs=3)
        for model in ("touch2touch", "resnet18")
    ]
