"""RMSE on synthetic data, held to the committed baseline: see benchmarks/regression.py."""

import json

from benchmarks.regression import BASELINE, failures, measure


def test_both_translators_stay_within_the_band(tmp_path, shape_cache):
    found = measure(tmp_path, cache=shape_cache)
    print(json.dumps(found, indent=1))
    assert not failures(found, json.loads(BASELINE.read_text()))


def test_the_band_fails_a_worse_model():
    baseline = json.loads(BASELINE.read_text())
    assert not failures(baseline, baseline)

    def changed(figure, change):
        by_split = baseline[figure]
        worse = {s: {m: change(x) for m, x in models.items()} for s, models in by_split.items()}
        return failures(baseline | {figure: worse}, baseline)

    assert len(changed("rmse_percent", lambda error: 1.3 * error)) >= 4
    assert len(changed("contact_iou", lambda overlap: overlap - 0.06)) == 4
