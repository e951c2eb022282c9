"""The table of renamed names: complete, unambiguous, and what errors and the changelog print."""

import importlib
import inspect
from importlib.util import find_spec
from pathlib import Path

import pytest

import t2twin
from benchmarks.documents.renames import KINDS
from t2twin.cli import COMMANDS, main
from t2twin.core import renames
from t2twin.core.errors import T2TwinError
from t2twin.core.records import decode_json
from t2twin.core.renames import message, table, translated

ROOT = Path(__file__).parents[1]


def of_kind(*kinds: str) -> list[renames.Rename]:
    return [each for each in table() if each.kind in kinds]


def refusal(*arguments: str, capsys) -> str:
    with pytest.raises(SystemExit):
        main([*arguments])
    return capsys.readouterr().err


def options(command: str) -> list[str]:
    parameters = inspect.signature(COMMANDS[command]).parameters
    return [
        "--" + ("no-" if each.default is True else "") + name.replace("_", "-")
        for name, each in parameters.items()
    ]


def test_every_rename_is_whole_and_unambiguous():
    assert list(table()) == sorted(set(table()))
    assert {each.kind for each in table()} <= set(KINDS)
    for kind in KINDS:
        old, new = ([getattr(each, of) for each in of_kind(kind)] for of in ("old", "new"))
        assert len(old) == len(set(old)) and all(old) and all(new), kind
        # A reader translates new files too, so no new key may be an old one.
        assert not set(old) & set(new), kind


@pytest.mark.parametrize("each", of_kind("import"), ids=lambda each: each.old)
def test_a_module_has_its_new_path_only(each):
    assert find_spec(each.new)
    place = ROOT.joinpath(*each.old.split("."))
    assert not place.with_suffix(".py").exists()
    with pytest.raises(ModuleNotFoundError, match=f"^{each.old} is now {each.new}$"):
        t2twin._RenamedModules.find_spec(each.old)  # pyright: ignore[reportAttributeAccessIssue]


def test_an_old_import_names_the_new_path():
    for statement in ("import t2twin.translate.predict", "from t2twin.translate import predict"):
        with pytest.raises(ImportError, match=r"predict is now t2twin\.translate\.inference\.pred"):
            exec(statement)
    with pytest.raises(ModuleNotFoundError, match=r"No module named 't2twin\.nothing'"):
        importlib.import_module("t2twin.nothing")


@pytest.mark.parametrize("each", of_kind("option"), ids=lambda each: each.old)
def test_an_old_option_names_the_new_one(each, capsys):
    *named, old = each.old.split()
    new = each.new.split()[-1]
    commands = [name for name in named or COMMANDS if new in options(name)]
    assert commands and not any(old in options(name) for name in commands)
    for command in commands:
        assert f"{old} is now {new}; see" in refusal(command, old, "1", capsys=capsys)


@pytest.mark.parametrize("each", of_kind("command"), ids=lambda each: each.old)
def test_an_old_command_names_the_new_one(each, capsys):
    assert each.new in COMMANDS
    assert f"{each.old} is now {each.new}; see" in refusal(each.old, capsys=capsys)


def test_a_renamed_public_name_is_named(few):
    assert not [each for each in of_kind("name") if each.old.removeprefix("t2twin.") in dir(t2twin)]
    with pytest.raises(AttributeError, match=r"^t2twin\.translator is now t2twin\.load$"):
        getattr(t2twin, "translator")  # noqa: B009


def test_a_renamed_field_is_named(few):
    from t2twin.sim.world.recipe import Place

    with pytest.raises(T2TwinError, match="no field looks; looks is now ood_class"):
        decode_json('{"normal_mm": 1.0, "looks": 1}', Place, "a file")


def test_keys_of_stored_files_are_translated(few):
    content = {"looks": "like", "each": [{"looks": 1, "std": 2}], "std": None}
    assert translated("json", content) == {
        "ood_class": "like", "each": [{"ood_class": 1, "std": 2}], "std": None
    }  # fmt: skip
    tensors = {"network/generator/place_rungs": 1, "place_rungs": 2, "a.place_rungs.b": 3, "c": 4}
    assert translated("safetensors", tensors) == {
        "network/generator/place_knots": 1, "place_knots": 2, "a.place_knots.b": 3, "c": 4
    }  # fmt: skip
    assert message("json", "std") is None


@pytest.fixture
def few(monkeypatch):
    """A table of three renames in place of the own one."""
    rows = (
        renames.Rename("json", "looks", "ood_class"),
        renames.Rename("name", "t2twin.translator", "t2twin.load"),
        renames.Rename("safetensors", "place_rungs", "place_knots"),
    )
    renames._by_old.cache_clear()
    monkeypatch.setattr(renames, "table", lambda: rows)
    yield
    renames._by_old.cache_clear()
