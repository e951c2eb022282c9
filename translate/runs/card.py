"""The model card of a run, RUN/README.md, for readers and for the Hugging Face hub."""

from dataclasses import asdict
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.templates import render
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import read_info
from t2twin.translate.data.pairs import load_info
from t2twin.translate.runs.config import BEST, best_epoch, load_config, read_log

CARD = "README.md"

LIMITS = "## Limits"  # Heading of the section on limits
TITLES = {"touch2touch": "touch2touch", "resnet18": "ResNet18", "field": "Field"}


def write_card(run_dir: Path, data_dir: Path) -> None:
    """Writes RUN/README.md from the run's configuration and log, and from its dataset.

    Raises T2TwinError for a dataset that the run was not trained on, a folder that is not a run,
    and a run without a finished epoch.
    """
    config, history = load_config(run_dir), read_log(run_dir)
    if load_info(data_dir).sha256 != (config.contact_data or config.data.sha256):
        raise T2TwinError(f"{data_dir} is not the dataset that {run_dir} was trained on")
    info, best = read_info(data_dir), best_epoch(history)
    text = render(
        "translate/runs/card.md",
        name=run_dir.absolute().name,
        title=TITLES[config.model],
        weights=BEST,
        limits=LIMITS,
        config=config,
        info=info,
        origin=_origin(info),
        history=history,
        best=best,
        metrics=[
            ("RMSE, counts", best.val_rmse_counts, ".1f"),
            ("RMSE, grey levels", best.val_rmse_grey, ".1f"),
            ("RMSE, % of full scale", best.val_rmse_percent, ".3f"),
            ("RMSE of the depth in the contact, mm", best.val_contact_error_mm, ".4f"),
        ],
        settings=asdict(config.preset)
        | {"direction": config.direction}
        | ({} if config.steps is None else {"steps (argument)": config.steps})
        | {
            "planned epochs": config.planned_epochs,
            "steps per epoch": config.epoch_steps or "all of the data",
            "seed": config.seed,
            "precision": config.precision,
            "processes": config.processes,
        },
    )
    with atomic_write(run_dir / CARD) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _origin(info: DatasetInfo) -> str:
    if not info.is_simulated:
        return "its owner, who imported the pairs"
    name = info.recipe_name
    return f"the paper's protocol, scale {name}" if info.is_protocol else f"the recipe {name}"
