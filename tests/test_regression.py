"""RMSE on synthetic data, held to the committed baseline: see benchmarks/networks/regression.py."""

import json
import os
import shutil

import pytest

from benchmarks.evidence.results import read_results
from benchmarks.evidence.run import missed
from benchmarks.networks import regression
from benchmarks.networks.regression import BENCHMARK, EPOCHS, against, train_and_evaluate

BASELINE = read_results(BENCHMARK.results).content


def failures(measured, baseline=BASELINE):
    return missed(BENCHMARK, {"against": against(measured, baseline)})


@pytest.mark.parametrize("model", ["resnet18", "touch2touch"])
def test_a_translator_stays_within_the_band(
    model, tmp_path, monkeypatch, protocol_dataset, shape_cache
):
    others = EPOCHS.keys() - {model}
    baseline = {
        figure: {
            split: {name: value for name, value in models.items() if name not in others}
            for split, models in BASELINE[figure].items()
        }
        for figure in ("rmse_percent", "contact_iou")
    }
    monkeypatch.setattr(regression, "EPOCHS", {model: EPOCHS[model]})
    # The dataset is complete, so that it is not made again.
    shutil.copytree(protocol_dataset, tmp_path / "data", copy_function=os.link)
    measured = train_and_evaluate(tmp_path, cache=shape_cache)
    print(json.dumps(measured, indent=1))
    assert not failures(measured, baseline)


def test_the_band_fails_a_worse_model():
    assert not failures(BASELINE)

    def changed(figure, change):
        by_split = BASELINE[figure]
        worse = {s: {m: change(x) for m, x in models.items()} for s, models in by_split.items()}
        return failures(BASELINE | {figure: worse})

    assert len(changed("rmse_percent", lambda error: 1.3 * error)) >= 4
    assert len(changed("contact_iou", lambda overlap: overlap - 0.06)) == 4
