"""Errors of the command line's parser as one sentence instead of tyro's boxes.

tyro reports errors to a hook (tyro._errors.on_parse_error), which is not part of its stable
interface. Therefore pyproject.toml pins the version of tyro.
"""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from typing import Any

from tyro import _errors

from t2twin.core.errors import T2TwinError

EXPECTED = {"FLOAT": "a number", "INT": "a whole number", "STR": "a name"}
"""Expected values by the metavar of an option; other metavars are self-explanatory."""

TAKES_RUN = ("export", "live", "translate")
"""Commands that take the run as an option."""

SHELLS = ("bash", "zsh", "tcsh", "fish")
"""Shells with completions of tyro."""

Commands = Mapping[str, Callable[..., None]]


@contextmanager
def one_sentence(commands: Commands, given: Sequence[str]) -> Iterator[None]:
    """Within the block, an invalid command line raises T2TwinError.

    commands: functions by the name of their subcommand. given: arguments of the command line.
    """
    error = ParserError(commands, given)
    error.check_completion()
    with _errors.on_parse_error(error.raise_for):
        yield


class ParserError:
    """Message for an invalid command line; arguments as for `one_sentence`."""

    def __init__(self, commands: Commands, given: Sequence[str]) -> None:
        self._commands, self._given = commands, given
        self._command = given[0] if given and given[0] in commands else None

    def raise_for(self, event: _errors.ParseErrorEvent) -> None:
        """Raises T2TwinError for a known event of tyro."""
        reason = self._reason(event)
        if reason is not None:
            program = "t2twin" if self._command is None else f"t2twin {self._command}"
            raise T2TwinError(f"{reason}; see {program} --help")

    def check_completion(self) -> None:
        """Raises T2TwinError for a completion of an unknown shell, for which tyro has no error."""
        words = [word.replace("_", "-") for word in self._given[:1]]
        if words and words[0] in ("--tyro-print-completion", "--tyro-write-completion"):
            shell = self._given[1] if len(self._given) > 1 else ""
            if shell not in SHELLS:
                raise T2TwinError(f"{words[0]} is {shell!r}; expected {_one_of(SHELLS)}")

    def _reason(self, event: _errors.ParseErrorEvent) -> str | None:
        if isinstance(event, _errors.MissingSubcommand):
            return f"a command is missing; expected {_one_of(tuple(self._commands))}"
        if isinstance(event, _errors.UnrecognizedArgs):
            return self._unrecognized(event.tokens[0])
        if isinstance(event, _errors.InvalidChoice):
            name = _name(event.argument)
            return f"{name} is {event.value!r}; expected {_expected(event.argument)}"
        missing = []
        if isinstance(event, _errors.MissingArgs):
            missing = [_name(each.arg) for each in event.missing_arguments]
        elif isinstance(event, _errors.BadValue):
            name = _name(event.argument)
            if not event.argument.is_positional():
                return f"{name} has no value; expected {_expected(event.argument)}"
            missing = [name]
        if missing:  # an argument is missing if an unknown option is in its place
            unknown = self._unknown_option()
            if unknown is not None:
                return self._unrecognized(unknown)
            return f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
        if isinstance(event, _errors.InstantiationFailure) and event.argument is not None:
            name = _name(event.argument)
            return f"{name} is {self._value(name)!r}; expected {_expected(event.argument)}"
        return None

    def _unrecognized(self, token: str) -> str:
        name = token.partition("=")[0]
        if self._command is None:
            kind, names = "option" if token.startswith("-") else "command", tuple(self._commands)
        elif token.startswith("-"):
            kind, names = "option", self._options()
        else:
            run = "; give a run with --run RUN" if self._command in TAKES_RUN else ""
            return f"unexpected argument {token!r}{run}"
        near = get_close_matches(name.lower(), names, 1)
        return f"there is no {kind} {name!r}" + (f" (did you mean {near[0]}?)" if near else "")

    def _options(self) -> tuple[str, ...]:
        names: list[str] = []
        parameters = inspect.signature(self._commands[self._command or ""]).parameters
        for name, parameter in parameters.items():
            options = getattr(parameter.annotation, "__origin__", None)  # of Annotated
            names += [field.name for field in fields(options)] if is_dataclass(options) else [name]
        return tuple("--" + name.replace("_", "-") for name in names)

    def _unknown_option(self) -> str | None:
        """The first unknown option."""
        known = ("--help", *(() if self._command is None else self._options()))
        for word in self._given:
            name = word.partition("=")[0].replace("_", "-")
            if name.startswith("--") and name != "--" and name not in known:
                return word
        return None

    def _value(self, option: str) -> str:
        """The last value of an option."""
        value = ""
        for word, after in zip(self._given, (*self._given[1:], ""), strict=True):
            name, equals, attached = word.partition("=")
            if name.replace("_", "-") == option:
                value = attached if equals else after
        return value


def _name(argument: Any) -> str:
    """Name of an option, or metavar of a positional argument, as in the help text."""
    lowered = argument.lowered
    return str(lowered.metavar) if argument.is_positional() else lowered.name_or_flags[-1]


def _expected(argument: Any) -> str:
    lowered = argument.lowered
    if lowered.choices:
        # Choices of an optional option include None and are unordered.
        optional = "None" in lowered.choices
        named = [name for name in lowered.choices if name != "None"]
        return _one_of(sorted(named) if optional else named)
    metavar = str(lowered.metavar)
    return EXPECTED.get(metavar, metavar)


def _one_of(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"
