import os
import shutil
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from ball_frames import write_frames

from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.cache_home import VARIABLE

ROOT = Path(__file__).parents[1]

REPORT_SHAPES = (
    "circle-1", "square-1", "hemisphere-4", "line-sharp-4", "square-3", "circle-3",
    "wrench/shank", "allen-key/long-arm",
)  # fmt: skip
"""Shapes whose solids are quick to make: four to train on, two to validate, two tools."""


def pytest_configure(config):
    """What numba compiles outlives the session, as it takes half a minute."""
    os.environ.setdefault("NUMBA_CACHE_DIR", str(config.cache.mkdir("numba")))


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
    home = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, str(home))
        yield catalogue.kept_in(None)


@pytest.fixture(scope="session")
def unit(tmp_path_factory):
    """Frames of a DIGIT whose light is known."""
    folder = tmp_path_factory.mktemp("unit")
    write_frames(folder)
    return folder


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of what is installed from, its links as links."""
    folder = tmp_path_factory.mktemp("checkout")
    for name in ("t2twin", "translate", "sim", "primitives_cad"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=ignored)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / name)
    return folder


@pytest.fixture(scope="session")
def shapes(shape_cache):
    """Catalogue shapes by name."""
    return lru_cache(maxsize=None)(lambda name: catalogue.load(name, shape_cache))


@pytest.fixture
def one_thread(monkeypatch):
    """Trainings take one thread, as another number changes the last digits."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")


@pytest.fixture(scope="module")
def runs(data_dir, tmp_path_factory):
    """Both translators, trained for three epochs on the module's own data_dir: their folders."""
    from spots import train_smoke  # imports torch, which most tests do without

    folder = tmp_path_factory.mktemp("runs")
    return [
        train_smoke(model, data_dir, folder / model, epochs=3)
        for model in ("touch2touch", "resnet18")
    ]


@pytest.fixture(scope="session")
def untrained_runs(tmp_path_factory):
    """Runs of both translators with the weights that a training begins with: their folders, for
    what does not ask how right they are."""
    from t2twin.sim.cyskin.layout import load_layout
    from t2twin.sim.cyskin.taxels import FULL_SCALE_COUNTS
    from t2twin.translate.build import build
    from t2twin.translate.data.pairs import DataInfo
    from t2twin.translate.presets import PAPER_MODELS, PRESETS
    from t2twin.translate.runs.checkpoint import save_weights
    from t2twin.translate.runs.config import BEST, RunConfig

    layout = load_layout()
    data = DataInfo("0" * 64, layout.name, layout.x_mm, layout.y_mm, FULL_SCALE_COUNTS)
    folders = [tmp_path_factory.mktemp("untrained") / model for model in PAPER_MODELS]
    for folder in folders:
        preset = PRESETS[folder.name]["smoke"]
        config = RunConfig(folder.name, preset, 0, data, None, None, 1, False, 1)
        config.save(folder)
        save_weights(folder / BEST, build(config).predictor)
    return folders


@pytest.fixture(scope="session")
def small_dataset(tmp_path_factory):
    """A simulated dataset of REPORT_SHAPES, 20 pairs; not to be written to."""
    from t2twin.sim.dataset.generate import generate

    folder = tmp_path_factory.mktemp("small") / "data"
    generate(folder, "smoke", workers=1, shapes=REPORT_SHAPES)
    return folder


@pytest.fixture(scope="module")
def phi():
    """phi of the layout that ships."""
    from t2twin.sim.cyskin.layout import load_layout
    from t2twin.translate.phi import Phi

    layout = load_layout()
    return Phi(layout.x_mm, layout.y_mm)


@pytest.fixture(scope="module")
def true():
    """(6, 20) counts: Gaussian responses about places in the middle of the array."""
    from t2twin.sim.cyskin.layout import load_layout

    layout = load_layout()
    rng = np.random.default_rng(0)
    places = rng.uniform(-4, 4, (6, 2))
    squares = (layout.x_mm - places[:, :1]) ** 2 + (layout.y_mm - places[:, 1:]) ** 2
    return 30000.0 * np.exp(-squares / 50.0)
