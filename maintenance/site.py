"""The documentation site, see mkdocs.yml: its pages besides those of docs/, by a hook of MkDocs;
lists of arguments in docstrings, by an extension of griffe."""

import re
from pathlib import Path
from typing import Any

from griffe import Extension, Object
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

import t2twin

ROOT = Path(__file__).parents[1]
PAGES = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md",
         "CHANGELOG.md": "changelog.md"}  # fmt: skip
LINK = re.compile(r"(?<=\]\()[^)#]+")
ENTRY = re.compile(r"(\w[\w, *]*): ")  # start of a line that describes arguments or attributes
END = re.compile(r"Returns |Raises ")  # start of a line that ends a list of arguments
API = """# API of all public names

Every name is a member of `t2twin`. [Python API](python-api.md) shows how they are used together.
Only the members that it lists stay in all versions 1.x.

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
    return {name: f"{getattr(t2twin, name).__module__}.{name}" for name in t2twin.__all__}


class ArgumentLists(Extension):
    """Changes the docstring of every object to Markdown with lists."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        if obj.docstring is not None:
            obj.docstring.value = as_lists(obj.docstring.value)


def as_lists(docstring: str) -> str:
    """The docstring with each description of arguments as an item of a list."""
    lines, is_list = [], False
    for line in docstring.splitlines():
        entry = ENTRY.match(line)
        if entry:
            lines += [] if is_list else [""]
            line, is_list = f"- `{entry.group(1)}`: {line[entry.end() :]}", True
        elif is_list and (END.match(line) or not line):
            lines, is_list = [*lines, ""], False
        elif is_list:
            line = f"    {line.strip()}"
        lines.append(line)
    return "\n".join(lines)
