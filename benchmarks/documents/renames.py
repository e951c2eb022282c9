"""The changelog's tables of renamed names."""

from t2twin.core.renames import table

KINDS = {
    "command": "Commands",
    "option": "Options",
    "keyword": "Keywords of functions and methods",
    "name": "Public names in Python",
    "import": "Modules",
    "json": "Keys of JSON files",
    "safetensors": "Keys of safetensors files",
    "value": "Values",
}
"""Kinds of names and their headings."""


def renames() -> str:
    """A heading and a table for each kind of name."""
    sections = []
    for kind, heading in KINDS.items():
        rows = [f"| `{each.old}` | `{each.new}` |" for each in table() if each.kind == kind]
        if rows:
            sections.append("\n".join([f"**{heading}**", "", "| 0.2 | 0.3 |", "|---|---|", *rows]))
    return "\n\n".join(sections)
