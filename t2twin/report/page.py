"""Self-contained HTML pages from the blocks of their sections; displayed names and colors."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from t2twin.core.draw import PALETTE
from t2twin.core.files import check_own, locked, result_folder
from t2twin.core.progress import Progress
from t2twin.core.templates import environment, render
from t2twin.translate.evaluation.baselines import (
    LAYOUT_FLOOR,
    MEAN_ARRAY,
    MEAN_ARRAY_OF_FORCE,
    NEAREST_NEIGHBOR,
    NOISE_FLOOR,
)

PAGE = "index.html"
MACROS = "report/templates/macros.html"

SPLIT_NAMES = {"train": "training", "val": "validation", "test": "test"}
NAMES = {
    MEAN_ARRAY: "mean array",
    MEAN_ARRAY_OF_FORCE: "mean array of the force",
    NEAREST_NEIGHBOR: "nearest neighbor",
    NOISE_FLOOR: "noise floor",
    LAYOUT_FLOOR: "layout floor",
    "resnet18": "ResNet18",
    **SPLIT_NAMES,
}
BASELINE_COLORS = {MEAN_ARRAY: "#222222", NEAREST_NEIGHBOR: PALETTE[5]}
SPLIT_COLORS = {"train": "#999999", "val": PALETTE[0], "test": PALETTE[1]}
KIND_NAMES = {"image": "gel camera", "counts": "taxel array"}

MAX_NAME = 20  # characters of a displayed shape name (assumed: half of a phone's width)
NAME_END = 6  # characters of its end that are preserved

Values = Callable[[], Mapping[str, Any] | None]
"""Computes the values of a section's block, or None to leave the section out."""


def check_out(out: Path) -> None:
    """Raises T2TwinError if out/index.html cannot be written or is another's. Leaves no files."""
    with locked(out):
        check_own(out, [PAGE], PAGE)


def write_page(
    out: Path,
    title: str,
    templates: Sequence[str],
    sections: Mapping[str, tuple[str, Values]],
    **shared: Any,
) -> Path:
    """Writes out/index.html, a self-contained page, and returns its path.

    templates: files with blocks of the sections' names. sections: by name, the title of the link to
    each, "" for none, and its values; the first is above the links. shared: values for all of them.
    """
    bodies = {}
    for name in Progress(list(sections), desc="report", unit="section"):
        values = sections[name][1]()
        if values is not None:
            bodies[name] = render_section(templates, name, **shared, **values)
    links = {name: sections[name][0] for name in bodies if sections[name][0]}
    with result_folder(out, PAGE) as temporary:
        text = render("report/templates/page.html", title=title, links=links, sections=bodies)
        (temporary / PAGE).write_text(text, encoding="utf-8")
    return out / PAGE


def render_section(templates: Sequence[str], name: str, /, **values: Any) -> str:
    """HTML of the block of a section, in the first of the templates that has it.

    It also has LABELS, and the macros of MACROS as `ui`.
    """
    block, ui = name.replace("-", "_"), environment().get_template(MACROS).module
    found = next(one for one in map(environment().get_template, templates) if block in one.blocks)
    return "".join(found.blocks[block](found.new_context({"ui": ui, **LABELS, **values})))


def name_of(model: str) -> str:
    """Displayed name of a split or a model: `resnet18 (seed-1)` becomes "ResNet18 (seed-1)"."""
    kind, space, rest = model.partition(" ")
    return NAMES.get(kind, kind) + space + printable(rest)


def shape_name(shape: str, most: int = MAX_NAME) -> str:
    """Displayed name of a shape: one line; a long name is shortened in the middle."""
    name = printable(shape)
    return name if len(name) <= most else f"{name[: most - NAME_END - 1]}…{name[-NAME_END:]}"


def printable(text: str) -> str:
    """Text with spaces in place of non-printable characters."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


LABELS = {
    "name_of": name_of,
    "shape_name": shape_name,
    "split_names": SPLIT_NAMES,
    "kind_names": KIND_NAMES,
    "pi": math.pi,
}
"""Functions and names for all templates of the pages."""
