"""Writes a self-contained HTML page."""

import tempfile
from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, locked
from t2twin.core.progress import Progress
from t2twin.report.html.style import STYLE

PAGE = "index.html"


def check_out(out: Path) -> None:
    """Checks that out/index.html can be written, without leaving files behind.

    Creates a temporary file in `out` or its nearest existing parent. Raises T2TwinError if `out` is
    a file, the page is a folder, or the folder is not writable.
    """
    try:
        if out.exists() and not out.is_dir():
            raise T2TwinError(f"{out} is a file; expected a folder for the report")
        if (out / PAGE).is_dir():
            raise T2TwinError(f"{out / PAGE} is a folder; choose another folder for the report")
        existing = next(folder for folder in (out, *out.parents) if folder.exists())
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise T2TwinError(
            f"{out} cannot be written to ({reason}); choose a writable folder for the report"
        ) from error


def write_page(
    out: Path,
    title: str,
    summary: Callable[[], str],
    sections: Mapping[str, Callable[[], str]],
    titles: Mapping[str, str],
) -> Path:
    """Writes out/index.html and returns its path.

    summary: HTML above the links. sections: HTML of each section by name. titles: of the links to
    the sections, by name.
    """
    makers = Progress([summary, *sections.values()], desc="report", unit="section")
    above, *body = [maker() for maker in makers]
    links = {name: titles[name] for name in sections if name in titles}
    path = out / PAGE
    with locked(path.parent), atomic_write(path) as temporary:
        temporary.write_text(_html(title, above, links, body), encoding="utf-8")
    return path


def _html(title: str, above: str, titles: Mapping[str, str], body: list[str]) -> str:
    links = " ".join(f'<a href="#{name}">{escape(text)}</a>' for name, text in titles.items())
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n{above}\n<nav>{links}</nav>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )
