import os

# Tests take one thread each, which NumPy reads when it is imported: the workers share the cores,
# and the last digits of a training depend on the number of threads.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import pickle
import shutil
import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from ball_frames import BALL_MM, HELD_OUT, small_digit, write_frames
from moving import write_recipe
from session import SESSION, Products, compile_loops, start

from t2twin.core.machine import cores
from t2twin.primitives_cad import catalogue

ROOT = Path(__file__).parents[1]

REPORT_SHAPES = (
    "circle-1", "square-1", "hemisphere-4", "line-sharp-4", "square-3", "circle-3",
    "wrench/shank", "allen-key/long-arm",
)  # fmt: skip
"""Shapes whose solids are quick to make: four to train on, two to validate, two tools."""


def pytest_configure(config):
    if SESSION not in os.environ:
        folder = start(*map(config.cache.mkdir, ("numba", "mujoco", "matplotlib")))
        config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
        config.add_cleanup(lambda: os.environ.pop(SESSION))
        if config.getoption("numprocesses", None) and not config.option.collectonly:
            compile_loops()


FIRST = (
    "test_documents.py", "test_contact_prediction.py", "test_regression.py", "test_examples.py",
    "test_calibrate_any_sensor.py", "test_any_pair.py", "test_calibrate.py", "test_studio_page.py",
    "test_recipe_datasets.py", "test_field.py", "test_calibrate_uncertainty.py",
    "test_training.py", "test_report.py",
)  # fmt: skip
"""Test files that take longest, in this order: while a worker runs one, the others run the rest."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers():
    """One worker more than cores, as tests often wait for processes and browsers."""
    return cores() + 1


def pytest_collection_modifyitems(items):
    order = {name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: order.get(item.path.name, len(FIRST)))


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
def session_folder():
    """The folder of the session. Fixtures of a session or module run in an empty folder of it."""
    folder = Path(os.environ[SESSION])
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder / "empty")
        yield folder


@pytest.fixture(scope="session", autouse=True)
def egl():
    """Skips what renders with pyrender on macOS, which has no EGL."""
    with pytest.MonkeyPatch.context() as patch:
        if sys.platform == "darwin":
            renderer = "t2twin.sim.optical.pyrender_renderer._import_pyrender"
            patch.setattr(renderer, lambda: pytest.skip("macOS has no EGL"))
        yield


@pytest.fixture(scope="session", autouse=True)
def quick_figures():
    """Reports draw one pair of each family of the small dataset and no more; the parts of figures
    are not moved apart, which takes as long as drawing them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("t2twin.report.dataset_report.PAIRS", 6)
        patch.setattr("matplotlib.figure.Figure.set_layout_engine", lambda *_, **__: None)
        yield


@pytest.fixture(autouse=True)
def own_folder(tmp_path):
    """Every test runs in its own temporary folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        yield tmp_path


@pytest.fixture(scope="session")
def products(session_folder):
    """Expensive products that all workers share; a test that changes one fails the session."""
    products = Products(session_folder / "products")
    yield products
    assert not (changed := products.changed()), f"tests wrote to shared products: {changed}"


@pytest.fixture(scope="session")
def shape_cache(session_folder):
    """The folder of the prepared shapes, which commands use too."""
    return catalogue.cache_folder(None)


@pytest.fixture(scope="session")
def unit(products):
    """Frames of a DIGIT whose light is known."""
    return products.make("unit", write_frames)


@pytest.fixture(scope="session")
def small_unit(products):
    """Frames of a DIGIT with small images."""
    return products.make("small-unit", lambda folder: write_frames(folder, small_digit()))


@pytest.fixture(scope="session")
def calibrated(small_unit, products):
    """What is fitted to the small frames, without its uncertainty, which takes as long again."""
    from t2twin.sim.calibrate import fit
    from t2twin.sim.calibrate.calibrate import calibrate

    def build(folder):
        folder.mkdir()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(fit, "MAX_STEPS", 1)  # it starts from the unit's own light
            given = small_unit / "background.png", small_unit, BALL_MM, HELD_OUT
            fitted = calibrate(*given, tolerance=None, sensor=small_digit())
        (folder / "report.pickle").write_bytes(pickle.dumps(fitted))

    return pickle.loads((products.make("calibrated", build) / "report.pickle").read_bytes())


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


@pytest.fixture(scope="session")
def trained(products):
    """Trains a translator at preset smoke, once for each dataset: (model, data_dir, epochs) to the
    folder of the run."""

    def run(model: str, data_dir: Path, epochs: int) -> Path:
        from spots import train_smoke  # imports torch, which most tests do without

        from t2twin.core.files import sha256_of
        from t2twin.sim.dataset.store import INFO

        name = f"{sha256_of(data_dir / INFO)}-{epochs}/{model}"
        return products.make(name, lambda folder: train_smoke(model, data_dir, folder, epochs))

    return run


@pytest.fixture(scope="session")
def data_dir(products):
    """The dataset of the module: of spots, 32, 12 and 8 pairs, unless it has another. Not to be
    written to."""
    from spots import write_spots

    return products.make("spots", write_spots)


@pytest.fixture(scope="module")
def runs(data_dir, trained):
    """Both translators, trained for three epochs on the module's own data_dir: their folders."""
    return [trained(model, data_dir, 3) for model in ("touch2touch", "resnet18")]


@pytest.fixture(scope="module", params=["touch2touch", "resnet18"])
def run_dir(request, data_dir, trained, tmp_path_factory):
    """A copy of the run of a translator, which the module may write to."""
    run = trained(request.param, data_dir, 3)
    return shutil.copytree(run, tmp_path_factory.mktemp("runs") / request.param)


@pytest.fixture(scope="session")
def untrained_runs(products):
    """Runs of both translators with the weights that a training begins with: their folders, for
    tests that do not depend on their errors."""
    from t2twin.translate.models.presets import PAPER_MODELS

    return [products.make(f"untrained/{model}", write_untrained) for model in PAPER_MODELS]


def write_untrained(folder):
    """Writes the run of the model that the folder is named after."""
    from kinds import gel_camera, taxel_array

    from t2twin.sim.dataset.generate import sensor_info
    from t2twin.translate.data.pairs import DataInfo
    from t2twin.translate.models.presets import PRESETS
    from t2twin.translate.runs.checkpoint import build, save_weights
    from t2twin.translate.runs.config import BEST, RunConfig

    model = folder.name
    data = DataInfo("0" * 64, sensor_info(gel_camera()), sensor_info(taxel_array()))
    config = RunConfig(model, PRESETS[model]["smoke"], 0, data, None, None, 1, False, 1)
    config.save(folder)
    save_weights(folder / BEST, build(config).predictor.state_dict())


@pytest.fixture(scope="session")
def small_dataset(products):
    """A simulated dataset of REPORT_SHAPES, 20 pairs; not to be written to."""
    from t2twin.sim.dataset.generate import make_dataset

    return products.make(
        "small", lambda folder: make_dataset(folder, "smoke", workers=1, shapes=REPORT_SHAPES)
    )


@pytest.fixture(scope="session")
def moving_dataset(products, tmp_path_factory):
    """A simulated dataset with motion, 15 pairs; not to be written to."""
    from t2twin.sim.dataset.generate import make_dataset

    recipe = write_recipe(tmp_path_factory.mktemp("recipe"))
    return products.make("moving", lambda to: make_dataset(to, recipe=recipe, workers=1))


@pytest.fixture(scope="module")
def phi():
    """phi of the layout that ships."""
    from t2twin.sim.sensors.pair import SensorPair

    return SensorPair().array.phi


@pytest.fixture(scope="module")
def true():
    """(6, 20) counts: Gaussian responses about places in the middle of the array."""
    from t2twin.sim.sensors.pair import SensorPair

    layout = SensorPair().array.layout
    rng = np.random.default_rng(0)
    places = rng.uniform(-4, 4, (6, 2))
    squares = (layout.x_mm - places[:, :1]) ** 2 + (layout.y_mm - places[:, 1:]) ** 2
    return 30000.0 * np.exp(-squares / 50.0)
