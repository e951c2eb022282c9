"""Pages that the documentation site has beside those of docs/: a hook of MkDocs, see mkdocs.yml.

The README, CONTRIBUTING and CHANGELOG are pages of the site. reference/api.md lists the full
documentation of every public name of t2twin.
"""

import ast
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
"""Files of the root, and the site's pages of them."""

LINK = re.compile(r"(?<=\]\()[^)#]+")
API = """# API of all public names

Every name is a member of `t2twin`. [Python API](python-api.md) shows how they are used together.

"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of PAGES and the API."""
    for source, page in PAGES.items():
        text = LINK.sub(lambda link: _moved(link.group()), (ROOT / source).read_text())
        files.append(File.generated(config, page, content=text))
    names = public_names()
    for name, path in names.items():
        _check_documented(name, path)
    listed = "".join(f"::: {names[name]}\n\n" for name in sorted(names, key=str.lower))
    files.append(File.generated(config, "reference/api.md", content=API + listed))
    return files


def public_names() -> dict[str, str]:
    """The public names of t2twin, and where each is defined."""
    tree = ast.parse((ROOT / "t2twin/__init__.pyi").read_text())
    return {
        alias.name: f"t2twin.{node.module}.{alias.name}"
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def _moved(link: str) -> str:
    """A link of a file of the root, as the page of the site has it."""
    return PAGES.get(link, link.removeprefix("docs/"))


def _check_documented(name: str, path: str) -> None:
    """Raises PluginError for a name without a docstring, and for public members without one."""
    import t2twin

    found: Any = getattr(t2twin, name)
    members = vars(found).items() if isinstance(found, type) else ()
    undocumented = [name] if not (found.__doc__ or "").strip() else []
    undocumented += [
        f"{name}.{member}"
        for member, value in members
        if not member.startswith("_") and callable(value) and not (value.__doc__ or "").strip()
    ]
    if undocumented:
        raise PluginError(f"{', '.join(undocumented)} of {path} has no docstring")
