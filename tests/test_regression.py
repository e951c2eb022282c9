"""RMSE on synthetic data, held to the committed baseline: see benchmarks/regression.py."""

import json

from benchmarks.regression import BASELINE, failures, measure


def test_both_translators_stay_within_the_band(tmp_path, shape_cache):
    found = measure(tmp_path, cache=shape_cache)
    print(json.dumps(found, indent=1))
    assert not failures(found, json.loads(BASELINE.read_text()))


def test_the_band_fails_a_worse_model():
    baseline = json.loads(BASELINE.read_text())
    worse = {
        split: {model: 1.3 * error for model, error in models.items()}
        for split, models in baseline["rmse_percent"].items()
    }
    assert not failures(baseline["rmse_percent"], baseline)
    assert len(failures(worse, baseline)) >= 4
