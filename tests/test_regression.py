"""RMSE on synthetic data, held to the committed baseline: see benchmarks/regression.py."""

import json
import os
import shutil

from benchmarks.declared import REGRESSION
from benchmarks.evidence.results import read_results
from benchmarks.evidence.run import missed
from benchmarks.regression import against, train_and_evaluate

BASELINE = read_results(REGRESSION.results).content


def failures(measured):
    return missed(REGRESSION, {"against": against(measured, BASELINE)})


def test_both_translators_stay_within_the_band(tmp_path, protocol_dataset, shape_cache):
    # The dataset is complete, so that it is not made again.
    shutil.copytree(protocol_dataset, tmp_path / "data", copy_function=os.link)
    measured = train_and_evaluate(tmp_path, cache=shape_cache)
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
