"""RMSE on synthetic data, held to the committed baseline: see benchmarks/networks/regression.py."""

import json

from benchmarks.evidence import read_results
from benchmarks.networks.regression import BENCHMARK, against, make_data, train_and_evaluate

BASELINE = read_results(BENCHMARK.results).content


def failures(measured):
    return BENCHMARK.missed({"against": against(measured, BASELINE)})


def test_translators_stay_within_the_band(tmp_path):
    make_data(tmp_path / "data")
    measured = train_and_evaluate(tmp_path / "data", tmp_path)
    print(json.dumps(measured, indent=1))
    assert not failures(measured)


def test_the_band_fails_a_worse_model():
    assert not failures(BASELINE)

    def changed(figure, change):
        by_split = BASELINE[figure]
        worse = {s: {m: change(x) for m, x in models.items()} for s, models in by_split.items()}
        return failures(BASELINE | {figure: worse})

    assert len(changed("rmse_percent", lambda error: 1.3 * error)) >= 4
    assert len(changed("contact_iou", lambda overlap: overlap - 0.06)) == 4
    assert len(changed("gain", lambda gain: 0.8 * gain)) == 4
