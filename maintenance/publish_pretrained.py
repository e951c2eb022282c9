"""Makes a pretrained run of a trained run and its evaluations.

    t2twin evaluate RUN --data data/paper --split both --out EVALUATION
    python -m maintenance.publish_pretrained NAME RUN EVALUATION

Trained weights are stored in half precision; buffers keep their precision.
"""

import json
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from safetensors.torch import load_file, save_file

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.templates import environment
from t2twin.translate.evaluation.records import ModelRow, read_evaluation
from t2twin.translate.runs.card import CARD, LIMITS
from t2twin.translate.runs.checkpoint import AVERAGE
from t2twin.translate.runs.config import (
    BEST,
    CONFIG,
    FRAME_CHECK,
    HOME,
    LOG,
    load_config,
    versioned,
)

# least size of a tensor in half precision (assumed: smaller ones are under 1 % in all)
MIN_NUMBERS = 1000
# ends of the names of buffers
FULL_PRECISION = ("correlation", "mean_frame", "running_mean", "running_var")
TABLE = Path(__file__).with_name("measured.md")  # template of the table in the card
MEAN = """\
## Training

The published weights are {0:g} times those described here, plus {1:.2g} times those that the
training started from.
"""
# shapes in the protocol's splits
SPLITS = {"val": "new versions of primitives", "test": "hand tools"}


def publish_pretrained(
    name: str, run_dir: Path, evaluations: Sequence[Path] = (), home: Path = HOME
) -> Path:
    """Writes a finished run, with the figures of evaluations in its card; returns home/name."""
    config = load_config(run_dir)
    for file in (BEST, CARD, LOG):
        if not (run_dir / file).is_file():
            raise T2TwinError(f"{run_dir / file} is not there; the run has not finished")
    card = (run_dir / CARD).read_text(encoding="utf-8")
    card = card.replace(", preset ", f", {versioned(name)}, preset ", 1)
    card = card.replace(f'load("{run_dir.name}")', f'load("{name}")')
    card = card.replace(f"--run {run_dir.name}`", f"--run {name}`")
    if (run_dir / AVERAGE).is_file():
        share = json.loads((run_dir / AVERAGE).read_text(encoding="utf-8"))["share"]
        card = card.replace("## Training\n", MEAN.format(share, 1.0 - share), 1)
    rows = [row for folder in evaluations for row in _rows(folder, config.data.sha256)]
    if rows:
        template = environment().from_string(TABLE.read_text(encoding="utf-8"))
        before, limits, after = card.partition(LIMITS)
        card = before + template.render(rows=rows) + limits + after
    folder = home / name
    folder.mkdir(parents=True, exist_ok=True)
    for path in filter(Path.is_file, (run_dir / BEST, run_dir / FRAME_CHECK)):
        weights = {
            key: each.half()
            if each.dim() >= 2 and each.numel() >= MIN_NUMBERS and not key.endswith(FULL_PRECISION)
            else each
            for key, each in load_file(path).items()
        }
        with atomic_write(folder / path.name) as temporary:
            save_file(weights, temporary)
            temporary.chmod(0o644)  # safetensors restricts it to the owner
    for file in (CONFIG, LOG):
        shutil.copyfile(run_dir / file, folder / file)
    with atomic_write(folder / CARD) as temporary:
        temporary.write_text(card, encoding="utf-8")
    return folder


def _rows(folder: Path, sha256: str) -> Iterator[tuple[str, ModelRow]]:
    """Rows of the run in the splits of an evaluation, with titles. sha256: of the training data."""
    splits = [split for split in SPLITS if (folder / split).is_dir()]
    if not splits:
        raise T2TwinError(f"{folder} contains no evaluation; give folders of `t2twin evaluate`")
    for split in splits:
        evaluation = read_evaluation(folder / split)
        rows = [row for row in evaluation.runs.values() if row.trained_data == sha256]
        if not rows:
            raise T2TwinError(f"{folder} has no evaluation of this run; evaluate it first")
        yield f"{evaluation.recipe or folder.name}, {SPLITS[split]}", rows[0]


if __name__ == "__main__":
    try:
        name, run, *evaluations = sys.argv[1:]
        print(publish_pretrained(name, Path(run), [Path(folder) for folder in evaluations]))
    except T2TwinError as error:
        sys.exit(str(error))
