"""JSON files that are whole or absent."""

import json
from pathlib import Path
from typing import Any

from primitives_cad.writing import whole_file


def write_json(path: Path, content: Any) -> None:
    """JSON with an indent of two."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n")
