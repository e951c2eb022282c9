"""The model card of a run, RUN/README.md, for readers and for the Hugging Face hub."""

from dataclasses import asdict
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.templates import render
from t2twin.sim.dataset.store import read_info
from t2twin.translate.data.pairs import load_info
from t2twin.translate.runs.config import BEST, best_epoch, load_config, read_log

CARD = "README.md"

LIMITS = "## Limits"  # Heading of the section on limits


def write_card(run_dir: Path, data_dir: Path) -> None:
    """Writes RUN/README.md from the run's configuration and log, and from its dataset. Raises
    T2TwinError for another dataset, and for a run without a finished epoch."""
    config, history = load_config(run_dir), read_log(run_dir)
    if load_info(data_dir).sha256 != (config.contact_data or config.data.sha256):
        raise T2TwinError(f"{data_dir} is not the dataset that {run_dir} was trained on")
    info, best = read_info(data_dir), best_epoch(history)
    text = render(
        "translate/runs/card.md", name=run_dir.absolute().name, weights=BEST, limits=LIMITS,
        config=config, info=info, history=history, best=best, settings=asdict(config.preset),
    )  # fmt: skip
    with atomic_write(run_dir / CARD) as temporary:
        temporary.write_text(text, encoding="utf-8")
