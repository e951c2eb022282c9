"""Files that are whole or absent: written under a temporary name, then renamed."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from t2twin.primitives_cad.errors import T2TwinError


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary path to write to, of the same suffix, that becomes `path` if all goes well.

    Makes the folder. Raises T2TwinError where it cannot be written.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise T2TwinError(
            f"{path} cannot be written ({error.strerror}); a writable folder is needed"
        ) from error
    finally:
        if temporary.parent.is_dir():
            temporary.unlink(missing_ok=True)


def write_json(path: Path, content: Any) -> None:
    """Write content as JSON, indented by two. Raises T2TwinError where it cannot be written."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n")
