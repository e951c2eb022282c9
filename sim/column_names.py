"""Checks the names of a table's columns, and of an object's keys, against those that are read."""

import difflib
import re
from collections.abc import Iterable, Sequence

from t2twin.primitives_cad.errors import T2TwinError

SIMILAR = 0.8
"""Least similarity of a misspelt name to the right one, by difflib's ratio (assumed)."""

UNIT = re.compile(r"[_ ]?\(?(?:um|mm|cm|m|mn|n|kn|g|kg|rad|deg|mpa|kpa)\)?$")
"""A unit at the end of a name."""

MAX_LISTED = 12
"""Most names that a message lists (assumed)."""


def check_names(
    names: Iterable[str],
    known: Sequence[str],
    source: object,
    others: bool = False,
    what: str = "column",
) -> None:
    """Raises T2TwinError for a name that comes twice, and for one that is not known.

    names: those of a table's columns, in its order. known: those that are read. source: what has
    the names, and what they are of, for the message. others: whether others are allowed that are
    not near a known one.
    """
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise T2TwinError(f"{source} has two {what}s {name}; leave one out")
        seen.add(name)
        if name in known:
            continue
        near = nearest(name, known)
        if near is not None:
            raise T2TwinError(
                f"{source} has a {what} {_shown(name)}, which is not read; did you mean {near}?"
            )
        if not others:
            raise T2TwinError(
                f"{source} has a {what} {_shown(name)}, which is not read; its {what}s may be "
                f"{', '.join(known[:MAX_LISTED])}"
            )


def nearest(name: str, known: Sequence[str]) -> str | None:
    """The known name that was probably meant, None where there is none.

    Names that differ in capitals, spaces or the unit at their end are near, and misspelt ones.
    """
    plain = {_plain(each): each for each in reversed(known)}
    roots = {UNIT.sub("", each): full for each, full in plain.items()}
    wanted = _plain(name)
    if found := plain.get(wanted) or roots.get(UNIT.sub("", wanted)):
        return found
    close = difflib.get_close_matches(wanted, plain, n=1, cutoff=SIMILAR)
    return plain[close[0]] if close else None


def _plain(name: str) -> str:
    return re.sub(r"[\s_-]+", "_", name.strip().lower())


def _shown(name: str) -> str:
    """In quotes, as it may have spaces, and not too long."""
    return repr(name if len(name) <= 40 else f"{name[:40]}...")
