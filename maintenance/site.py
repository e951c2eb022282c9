"""Pages that the documentation site has beside those of docs/: a hook of MkDocs, see mkdocs.yml."""

import ast
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
PAGES = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md",
         "CHANGELOG.md": "changelog.md"}  # fmt: skip
LINK = re.compile(r"(?<=\]\()[^)#]+")
API = """# API of all public names

Every name is a member of `t2twin`. [Python API](python-api.md) shows how they are used together.

"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of PAGES and the API."""
    for source, page in PAGES.items():
        text = (ROOT / source).read_text()
        text = LINK.sub(lambda it: PAGES.get(it[0], it[0].removeprefix("docs/")), text)
        files.append(File.generated(config, page, content=text))
    names = public_names()
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
