"""Sections that a dataset does not say enough for."""

from t2twin.report.data import ReportData

UNKNOWN = {
    "by-view": "where the picture lies over the taxels",
    "shapes": "what the shapes look like",
    "forces": "forces carried and depths",
}
"""Sections of simulated datasets alone, by what imported pairs do not say."""


def left_out(report: ReportData) -> dict[str, str]:
    """The names of the sections that are not drawn, and what is missing for each.

    The shapes are drawn of the paper's protocol, whose they are; and what is said of several forces
    is not missed where there is one.
    """
    missing = {} if report.info.is_simulated else dict(UNKNOWN)
    if not report.info.is_protocol:
        missing["shapes"] = UNKNOWN["shapes"]
    if any(evaluation.irreducible_error is None for evaluation in report.evaluations.values()):
        missing["lookalikes"] = "the noise of the pictures"
    if not report.gap and not any(one.findings for one in report.evaluations.values()):
        missing["finding"] = "runs of both translators"
    return missing
