"""The paper's table for this dataset, with the paper's values, and the paper's finding."""

from typing import Any

from t2twin.report.data import ReportData
from t2twin.report.html.labels import name_of
from t2twin.translate.evaluation.table import FURTHER, MAIN, figures_table, findings_table

TITLES = {"val": "Validation, unseen versions", "test": "Test, objects"}
"""Titles of the splits of the paper's protocol."""


def section(report: ReportData) -> dict[str, Any]:
    """Two tables of the figures."""
    evaluations = report.evaluations
    titles = {
        split: TITLES[split] if report.info.is_protocol else name_of(split).capitalize()
        for split in evaluations
    }
    with_pairs = {s: f"{titles[s]} ({one.pairs:,} pairs)" for s, one in evaluations.items()}
    own = "This dataset" + ", simulated" * report.info.is_simulated
    return {
        "main": figures_table(evaluations, MAIN, with_pairs, name_of, own=own),
        "further": figures_table(evaluations, FURTHER, titles, name_of),
    }


def finding(report: ReportData) -> dict[str, Any]:
    """Answers to the paper's statements, with bootstrap intervals."""
    return {"table": findings_table(report.evaluations, report.gap, name_of)[0]}
