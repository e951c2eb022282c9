"""Public names that changed after version 0.3. The use of a former one is an error that names the
new one."""

from collections.abc import Callable, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

from t2twin.core.errors import T2TwinError

NEW_NAMES = {
    "calibration": "optics",
    "evaluate_worlds": "evaluate_datasets",
    "field": "dense_counts",
    "field_std": "dense_counts_std",
    "field_x_mm": "dense_x_mm",
    "field_y_mm": "dense_y_mm",
    "sample_fields": "sample_dense_counts",
    "untouched_frames": "background_frames",
    "untouched_share": "background_share",
    "world": "recipe",
}
"""Of functions, keywords, attributes, and keys of files, by the former name."""

NEW_OPTIONS = {"--calibration": "--optics", "--world": "--recipe"}

RENDERERS = ("baked", "pyrender")
"""Former values of optics, which is now a file."""

F = TypeVar("F", bound=Callable[..., Any])


def hint(name: str) -> str:
    """The end of a message about an unknown name: its new one, if it is a former one."""
    return f"; {name} is now {NEW_NAMES[name]}" if name in NEW_NAMES else ""


def new_keywords(function: F) -> F:
    """The function, which raises T2TwinError for a keyword with a former name or meaning."""

    @wraps(function)
    def checked(*args: Any, **keywords: Any) -> Any:
        for name in keywords:
            if name in NEW_NAMES:
                raise T2TwinError(f"there is no keyword {name}{hint(name)}")
        if keywords.get("optics") in RENDERERS:
            raise T2TwinError(
                f"optics is {keywords['optics']!r}; expected a file of `t2twin calibrate`, as what "
                "renders the images is now renderer"
            )
        return function(*args, **keywords)

    return cast(F, checked)


def check_options(given: Sequence[str]) -> None:
    """Raises T2TwinError for an option of the command line with a former name or meaning."""
    for word, value in zip(given, [*given, ""][1:], strict=True):
        name, _, own = word.partition("=")
        if name in NEW_OPTIONS:
            raise T2TwinError(f"there is no option {name}; {name} is now {NEW_OPTIONS[name]}")
        if name == "--optics" and (own or value) in RENDERERS:
            raise T2TwinError(
                f"--optics is {own or value}; expected a file of `t2twin calibrate`, as what "
                "renders the images is now --renderer"
            )


class NewAttributes:
    """A class whose former attributes have new names."""

    if not TYPE_CHECKING:  # type checkers report attributes that a class does not have

        def __getattr__(self, name: str) -> Any:
            kind = type(self).__name__
            raise AttributeError(f"{kind!r} object has no attribute {name!r}{hint(name)}")
