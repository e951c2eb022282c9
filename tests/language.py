"""Words of the project's former private language, and where product code still has them.

python -m tests.language            counts by word and by file
python -m tests.language PATH ...   every place below these paths
"""

import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PRODUCT = ("t2twin", "translate", "sim", "primitives_cad")
SUFFIXES = (".py", ".toml", ".js", ".html", ".css", ".md")

WORDS = {
    "anew": "again",
    "asked asks asking": "request, expect",
    "beside": "next to",
    "certainty": "uncertainty",
    "coat": "coating",
    "familiar": "in distribution",
    "fewest": "min",
    "feel feels felt": "measure",
    "heed heeds heeded": "handle",
    "judge judges judged": "verify, evaluate",
    "kin": "family",
    "know knows knew": "name what is stored",
    "lookalike lookalikes": "irreducible error",
    "looks": "image statistics",
    "mend mends mended mending": "repair",
    "newest": "latest",
    "road": "pipeline",
    "rung rungs": "knot",
    "say says said saying": "state, print, name",
    "ship ships shipped shipping": "pretrained, bundled",
    "sure surer surest sureness unsure": "uncertainty, reliability",
    "tell tells told telling teller": "predict, convert, readout",
    "temper tempers tempered tempering": "recalibrate",
    "untouched": "background frame",
    "wants": "need",
    "yardstick": "benchmark",
}
"""Words, also as parts of identifiers, and their standard terms."""

SAMPLING = {"draw draws drawn drawing drew": "sample"}
"""The same where nothing is plotted: in PLOTLESS."""

PLOTLESS = ("sim/", "primitives_cad/random_shapes/", "translate/")

IDENTIFIERS = {
    "AT_ONCE": "BATCH_SIZE",
    "Drawn": "PressSample",
    "LIKE": "an enum of uncertainty/ood.py",
    "UNLIKE": "an enum of uncertainty/ood.py",
    "Made": "ShardResult",
    "Making": "ShardContext",
    "More": "ExtraColumns",
    "Known": "a name for its content",
    "OtherWay": "CySkinToDigit",
    "Road": "AdaptConfig",
    "Span": "Bounds",
    "TrainingLoop": "Trainer",
    "Translated": "TranslationResult",
    "carried": "redistribute_force",
    "draw_touch": "sample_press",
    "evenly_in_log": "log_uniform",
    "factor_at": "interpolate_scale",
    "falls_by": "sparsification_gain",
    "find_run": "resolve_run",
    "held_percent": "coverage",
    "in_hand": "pending_writes",
    "lay": "set_state",
    "like_training": "in_distribution",
    "off": "residual",
    "other_way": "reverse",
    "picture_of": "tactile_image_of, digit_image",
    "reason_to_stop": "stop_reason",
    "shape_loss": "soft_iou_loss",
    "sharpen": "precondition",
    "take_away": "export_zip",
}
"""Whole identifiers of code, and their standard terms; in text they are plain words."""

WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
"""Words of an identifier in snake case or camel case."""

PREFIXES = {"MOST_": "MAX_", "LEAST_": "MIN_", "FEWEST_": "MIN_"}

PHRASES = {
    "of which": "name the thing again",
    "given the say": "decide",
    "holds its word": "is calibrated",
    "put right": "recalibrate",
    "stands? in for": "replace",
}


class Allowed(NamedTuple):
    """path: of a file or folder, with "/" at its end; "" for all. token: an identifier or word."""

    path: str
    token: str
    reason: str


ALLOWED = (
    Allowed("", "untouched_share", "field of a recipe"),
    Allowed("", "untouched_frames", "field of a recipe"),
    Allowed("sim/world/", "draw", "field of a recipe's light"),
    Allowed("sim/dataset/shard.py", "draw", "field of a recipe's light"),
    Allowed("sim/world/", "drawn", "kind of a recipe's light"),
    Allowed("sim/world/recipe.py", "untouched", "value of a recipe of version 0.2"),
    Allowed("sim/dataset/columns.py", "untouched", "column of a dataset"),
    Allowed("sim/dataset/card.md", "untouched", "column of a dataset"),
    Allowed("sim/dataset/shard.py", "untouched", "path of a dataset's images"),
    Allowed("sim/world/", "shipped", "name of a world"),
    Allowed("t2twin/cli/dataset.py", "shipped", "name of a world"),
    Allowed("translate/weights/", "shipped", "name of a world"),
    Allowed("sim/cyskin/tactile_image.py", "ImageDraw", "Pillow"),
    Allowed("sim/cyskin/tactile_image.py", "Draw", "Pillow"),
)
"""Places where data formats use these words, at most 20."""


class Place(NamedTuple):
    path: str
    line: int
    word: str
    standard: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.word} ({self.standard})"


def places(root: Path = ROOT) -> list[Place]:
    """Every private word in product code, with what ALLOWED leaves out."""
    found = []
    for folder in PRODUCT:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in SUFFIXES and not any(up.is_symlink() for up in path.parents):
                name = path.relative_to(root).as_posix()
                found += in_text(path.read_text(encoding="utf-8"), name)
    return found


def in_text(text: str, path: str) -> Iterator[Place]:
    """Places of private words in a file's name and text. path: from the root, for its rules."""
    words = by_word(WORDS | (SAMPLING if path.startswith(PLOTLESS) else {}))
    allowed = {each.token for each in ALLOWED if path.startswith(each.path)}
    for number, line in enumerate((path, *text.splitlines())):
        for token in re.findall(r"[A-Za-z_][A-Za-z_0-9]*", line):
            for part in () if token.strip("_") in allowed else WORD.findall(token):
                if part.lower() in words:
                    yield Place(path, number, part.lower(), words[part.lower()])
    for number, name in identifiers(text) if path.endswith(".py") else ():
        whole = name.lstrip("_")
        standard = IDENTIFIERS.get(whole) or PREFIXES.get(f"{whole.partition('_')[0]}_")
        if standard is not None and whole not in allowed:
            yield Place(path, number, whole, standard)
    for phrase, standard in PHRASES.items():
        for match in re.finditer(phrase.replace(" ", r"\s+(?:#\s*)?"), text):
            yield Place(path, text.count("\n", 0, match.start()) + 1, phrase, standard)


def identifiers(text: str) -> Iterator[tuple[int, str]]:
    """Line and name of every identifier of Python code, without comments and strings."""
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.NAME:
            yield token.start[0], token.string


def by_word(groups: dict[str, str]) -> dict[str, str]:
    return {word: standard for group, standard in groups.items() for word in group.split()}


def main(arguments: list[str]) -> None:
    found = places()
    if arguments:
        print(*(each for each in found if each.path.startswith(tuple(arguments))), sep="\n")
        return
    for of in ("word", "path"):
        print(f"\nby {of}")
        for name, count in Counter(getattr(each, of) for each in found).most_common():
            print(f"{count:6d}  {name}")
    print(f"\n{len(found)} places in all")


if __name__ == "__main__":
    main(sys.argv[1:])
