"""Writes a self-contained HTML page from the templates of its sections."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from t2twin.core.files import atomic_write, check_replaceable, locked
from t2twin.core.progress import Progress
from t2twin.core.templates import environment, render
from t2twin.report.html.labels import LABELS

PAGE = "index.html"
MACROS = "report/templates/macros.html"

Sections = Mapping[str, tuple[str, Callable[[], Mapping[str, Any]]]]
"""Template of each section by name, and the function that computes its values."""


def check_out(out: Path) -> None:
    """Raises T2TwinError if out/index.html cannot be written. Leaves no files behind."""
    with locked(out):
        check_replaceable(out / PAGE)


def write_page(
    out: Path, title: str, sections: Sections, links: Mapping[str, str], **shared: Any
) -> Path:
    """Writes out/index.html and returns its path.

    sections: in their order; the first is above the links. links: titles of the links to the
    sections, by name. shared: values for all sections.
    """
    bodies = {}
    for name in Progress(list(sections), desc="report", unit="section"):
        template, values = sections[name]
        bodies[name] = render_section(template, **shared, **values())
    present = {name: text for name, text in links.items() if name in sections}
    path = out / PAGE
    with locked(path.parent), atomic_write(path) as temporary:
        text = render("report/templates/page.html", title=title, links=present, sections=bodies)
        temporary.write_text(text, encoding="utf-8")
    return path


def render_section(template: str, /, **values: Any) -> str:
    """HTML of a section. Templates also have LABELS, and the macros of MACROS as `ui`."""
    return render(template, ui=environment().get_template(MACROS).module, **LABELS, **values)
