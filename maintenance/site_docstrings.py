"""The documentation site lists docstrings' lines on arguments: an extension of griffe."""

import re
from typing import Any

from griffe import Extension, Object

ENTRY = re.compile(r"(\w[\w, *]*): ")  # start of a line that describes arguments or attributes
END = re.compile(r"Returns |Raises ")  # start of a line that ends a list of arguments


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
