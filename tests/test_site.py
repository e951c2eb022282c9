"""The documentation site, which `make docs` builds: what is added to the pages of docs/."""

from pathlib import Path

import pytest
import yaml

import t2twin
from maintenance.site import PAGES, public_names
from maintenance.site_docstrings import as_lists

ROOT = Path(__file__).parents[1]


def test_arguments_are_listed() -> None:
    docstring = "Summary.\n\nx_mm, y_mm: place.\n    More of it.\nforce: in N.\nReturns a number."
    assert as_lists(docstring) == (
        "Summary.\n\n\n- `x_mm, y_mm`: place.\n    More of it.\n- `force`: in N.\n\n"
        "Returns a number."
    )


def test_the_api_contains_every_public_name() -> None:
    assert set(public_names()) == set(t2twin.__all__)


@pytest.mark.parametrize("name", PAGES)
def test_pages_of_the_root_exist(name: str) -> None:
    assert (ROOT / name).is_file()


def test_every_page_is_in_the_navigation() -> None:
    listed = str(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"])
    for page in (ROOT / "docs").rglob("*.md"):
        assert page.relative_to(ROOT / "docs").as_posix() in listed, page
