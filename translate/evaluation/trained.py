"""What a row's run was trained on, in words."""

from collections.abc import Mapping

from t2twin.translate.evaluation.records import Evaluation, ModelRow

UNKNOWN = "-"


def trained_on(row: ModelRow, known: Mapping[str, str] | None = None) -> tuple[str, str, str]:
    """The world, the number of training pairs and of steps; a dash for what is not known.

    known: names of worlds by the SHA-256 of their datasets' info.json, for runs of older versions,
    which do not say. A dataset without a name is called by its first digits.
    """
    sha256 = row.trained_data or ""
    world = row.trained_world or (known or {}).get(sha256)
    unnamed = f"data set {sha256[:8]}" if sha256 else UNKNOWN
    return world or unnamed, _number(row.trained_pairs), _number(row.trained_steps)


def trained_lines(evaluation: Evaluation) -> list[str]:
    """A line a run, as in "resnet18 was trained on paper, 14,112 pairs, 5,292 steps."."""
    lines = []
    for name, row in evaluation.runs.items():
        world, pairs, steps = trained_on(row)
        numbers = ((pairs, "pairs"), (steps, "steps"))
        known = [f"{number} {what}" for number, what in numbers if number != UNKNOWN]
        lines.append(f"{name} was trained on {', '.join((world, *known))}.")
    return lines


def background_lines(evaluation: Evaluation) -> list[str]:
    """A line on the background frame, where a run was given one."""
    if evaluation.background is None:
        return []
    return [f"Background frame given to the field runs: {evaluation.background}."]


def _number(value: int | None) -> str:
    return UNKNOWN if value is None else f"{value:,}"
