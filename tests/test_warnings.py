"""Functions warn of what the commands print."""

import numpy as np
import pytest
from PIL import Image

import t2twin
from t2twin.cli import main
from t2twin.translate.inference.files import translate_contacts

CALLS = {
    "predict": lambda run, image: run.predict(image),
    "estimate": lambda run, image: run.estimate([image, image]),
    "contact": lambda run, image: run.contact(image),
    "tactile_images": lambda run, image: run.tactile_images(image),
    "translate_images": lambda run, image: t2twin.translate_images(["grey.png"], "out"),
    "translate_contacts": lambda run, image: translate_contacts("field", ["grey.png"], "out"),
}


@pytest.fixture
def grey() -> np.ndarray:
    image = t2twin.press("hemisphere-4", force_n=6).image
    grey = np.dstack([image.mean(axis=2).astype(np.uint8)] * 3)
    Image.fromarray(grey).save("grey.png")
    return grey


@pytest.mark.parametrize("name", CALLS)
def test_functions_warn_of_images_out_of_distribution(name: str, grey: np.ndarray) -> None:
    with pytest.warns(t2twin.T2TwinWarning) as found:
        CALLS[name](t2twin.load(), grey)
    said = [str(each.message) for each in found]
    assert sum("without color" in each for each in said) == 1
    is_of_files = name.startswith("translate")
    assert any("no background frame" in each for each in said) == is_of_files
    assert all(each.filename == __file__ for each in found)


@pytest.mark.parametrize("target", ["counts", "contact"])
def test_commands_print_the_warnings_in_one_line_each(target, grey, capsys):
    main(["translate", "grey.png", "--target", target])
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("t2twin: no background frame") and "grey.png" in lines[1]


@pytest.mark.parametrize("options", [
    "--verify data --seed 1", "--recipe open --layout cyskin-63",
    "--scale smoke --scheduler tcp://127.0.0.1:1 --workers 2",
])  # fmt: skip
def test_options_without_effect_are_refused(options, capsys):
    with pytest.raises(SystemExit):
        main(["simdata", *options.split()])
    said = capsys.readouterr().err
    assert "has no effect beside" in said or "are both given" in said
