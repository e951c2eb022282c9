"""The use of a former public name is an error that names the new one."""

# Former names are errors for type checkers too.
# pyright: reportCallIssue=false, reportAttributeAccessIssue=false

import pytest

import t2twin
from t2twin.cli import main
from t2twin.core.errors import T2TwinError


@pytest.mark.parametrize(
    "call, said",
    [
        (lambda: t2twin.Twin(calibration="optics.npz"), "calibration is now optics"),
        (lambda: t2twin.Twin(optics="pyrender"), "what renders the images is now renderer"),
        (lambda: t2twin.make_dataset("out", world="open"), "world is now recipe"),
        (lambda: t2twin.attach(None, sensor="digit", calibration="a"), "is now optics"),
    ],
)
def test_keywords(call, said):
    with pytest.raises(T2TwinError, match=said):
        call()


def test_attributes():
    touch = t2twin.press("circle-1")
    with pytest.raises(AttributeError, match=r"'Touch' .* 'field'; field is now dense_counts"):
        touch.field  # noqa: B018
    with pytest.raises(AttributeError, match="evaluate_worlds is now evaluate_datasets"):
        t2twin.evaluate_worlds  # noqa: B018
    assert not hasattr(touch, "other")


def test_keys_of_a_recipe(tmp_path):
    part = '[[parts]]\nshapes = "random"\ncount = 1\n'
    path = tmp_path / "r.toml"
    path.write_text(f'format = 1\nname = "r"\nuntouched_frames = true\n{part}')
    with pytest.raises(T2TwinError, match="untouched_frames is now background_frames"):
        t2twin.load_recipe(path)


@pytest.mark.parametrize(
    "words, said",
    [
        ("simdata --world open", "--world is now --recipe"),
        ("press circle-1 --calibration=a.npz", "--calibration is now --optics"),
        ("press circle-1 --optics pyrender", "is now --renderer"),
    ],
)
def test_options(words, said, capsys):
    with pytest.raises(SystemExit) as stop:
        main(words.split())
    assert stop.value.code == 2 and said in capsys.readouterr().err
