"""A training that begins with another run's weights."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from msgspec import structs

from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.core.files import sha256_of
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.sampling.recipe import load_recipe
from t2twin.translate.data.pairs import load_info, load_pairs
from t2twin.translate.inference.load import load_run
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.presets import PAPER_MODELS, PRESETS
from t2twin.translate.runs.checkpoint import build
from t2twin.translate.runs.config import CONFIG, load_config
from t2twin.translate.training.train import (
    WARM_START_SHARE,
    find_weights,
    load_initial_weights,
    train,
)

RECIPE = """
name = "tiny"
seed = {seed}

[[parts]]
shapes = "random"
count = 4
presses = 4
place = {{ normal_mm = 2.5 }}
force_n = {force}
val_share = 0.25

[light]
kind = "drawn"
"""


def recipe(folder: Path, seed: int, force: str) -> Path:
    folder.mkdir()
    recipe = folder / "tiny.toml"
    recipe.write_text(RECIPE.format(seed=seed, force=force))
    make_dataset(folder / "data", recipe=load_recipe(str(recipe)), workers=1)
    return folder / "data"


@pytest.mark.parametrize("number", range(len(PAPER_MODELS)))
def test_begins_where_the_other_run_ended(runs: list[Path], data_dir: Path, number: int) -> None:
    model, info = PAPER_MODELS[number], load_info(data_dir)
    earlier = load_run(runs[number])
    start = find_weights(runs[number], model, earlier.config.preset, info)
    averaged = replace(earlier.config.preset, averaged_part=0.1)
    fresh = build(structs.replace(earlier.config, seed=7, preset=averaged))
    pictures = load_pairs(data_dir, "val", averaged.size, averaged.grey).images[:4]
    load_initial_weights(start, fresh)
    np.testing.assert_allclose(
        replace(earlier, translator=fresh)._predict_pixels(pictures),
        earlier._predict_pixels(pictures),
        atol=2.0,  # the run's batch norms lie in its convolutions
    )
    learns = next(iter(fresh.networks.values())).state_dict()
    for name, tensor in fresh.predictor.state_dict().items():
        assert torch.equal(tensor, learns[name])


def test_a_start_saves_steps_and_is_kept_in_mind(
    runs: list[Path], data_dir: Path, tmp_path: Path
) -> None:
    fresh = train("resnet18", data_dir, "smoke", tmp_path / "fresh", epochs=1)
    begun = train("resnet18", data_dir, "smoke", tmp_path / "begun", epochs=1, init_from=runs[1])
    assert begun.best_rmse_percent < 0.8 * fresh.best_rmse_percent
    config = load_config(tmp_path / "begun")
    weights = find_weights(runs[1], "resnet18", config.preset, config.data)
    assert config.init_from == sha256_of(weights)
    other = structs.replace(config.data.source, name="other")
    with pytest.warns(T2TwinWarning, match="new run of images of other, another sensor"):
        find_weights(runs[1], "resnet18", config.preset, structs.replace(config.data, source=other))
    smoke = PRESETS["resnet18"]["smoke"]
    lower = WARM_START_SHARE * smoke.learning_rate
    assert config.preset == replace(smoke, learning_rate=lower)
    assert load_config(tmp_path / "fresh").init_from is None
    for other in (None, tmp_path / "fresh"):
        with pytest.raises(T2TwinError, match="holds a run with another"):
            train("resnet18", data_dir, "smoke", tmp_path / "begun", epochs=1, init_from=other)


def test_a_field_run_keeps_what_it_knows_but_for_the_mean_frame(tmp_path: Path) -> None:
    one = recipe(tmp_path / "one", 5, "8.0")
    several = recipe(tmp_path / "several", 6, "{ low = 1.0, high = 10.0 }")
    train("field", one, "smoke", tmp_path / "run", epochs=1)
    config = load_config(tmp_path / "run")
    translator = build(config)
    assert isinstance(translator, FieldTranslator)
    start = find_weights(tmp_path / "run", "field", config.preset, load_info(several))
    load_initial_weights(start, translator)
    before = {name: tensor.clone() for name, tensor in translator.network.state_dict().items()}
    translator.prepare(
        load_pairs(several, "train", config.preset.size, False, with_dense_counts=True)
    )
    after = translator.network.state_dict()
    changed = {name for name, tensor in after.items() if not torch.equal(tensor, before[name])}
    assert changed == {"mean_frame", "force_scale"}  # the force was the same in all it had seen
    translator.prepare(load_pairs(one, "train", config.preset.size, False, with_dense_counts=True))
    assert float(translator.network.force_scale[1]) > 0.1  # what is known of forces stays


def test_what_cannot_be_begun_with_is_one_sentence(
    runs: list[Path], data_dir: Path, tmp_path: Path
) -> None:
    def refused(start: Path, model: str = "resnet18") -> str:
        with pytest.raises(T2TwinError) as error:
            train(model, data_dir, "smoke", tmp_path / "run", init_from=start)
        assert not (tmp_path / "run").exists()
        return str(error.value)

    assert "there is no run" in refused(tmp_path / "none")
    assert "has no config.json" in refused(tmp_path)
    assert "is a touch2touch run" in refused(runs[0])
    config = json.loads((runs[1] / CONFIG).read_text())
    config["preset"]["filters"] = 8
    (tmp_path / "wide").mkdir()
    (tmp_path / "wide" / CONFIG).write_text(json.dumps(config))
    assert "has the base width 8, and the new run has" in refused(tmp_path / "wide")
