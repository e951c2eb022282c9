"""Whether a command that was disturbed gave what it gives undisturbed."""

import hashlib
import json
import zipfile
from pathlib import Path

NOT_COMPARED = {"log.jsonl", "tensorboard", "cache", "README.md"}
"""Names of files and folders that hold times, or are kept for speed alone."""


def same_results(wanted: Path, there: Path) -> bool:
    """Whether two files or folders hold the same, times and places left out."""
    if wanted.is_file():
        return there.is_file() and _digest(wanted) == _digest(there)
    return there.is_dir() and _digests(wanted) == _digests(there)


def _digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): _digest(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not NOT_COMPARED & set(path.relative_to(folder).parts)
    }


def _digest(path: Path) -> str:
    if path.suffix in (".html", ".safetensors") and path.name != "best.safetensors":
        return "there"  # a page has its date; a training's state has the seconds of its epochs
    if path.suffix == ".npz":
        with zipfile.ZipFile(path) as archive:  # which has times of its own
            parts = [(name, archive.read(name)) for name in sorted(archive.namelist())]
        return hashlib.sha256(repr(parts).encode()).hexdigest()
    if path.name == "config.json":  # the machine's speed decides nothing here but is in it
        content = json.loads(path.read_text())
        return json.dumps({key: content[key] for key in ("model", "preset", "seed", "epochs")})
    return hashlib.sha256(path.read_bytes()).hexdigest()
