"""README.md and docs/ say what the results files hold."""

import pytest

from benchmarks.documents import markers, tables
from benchmarks.documents.formats import formatted
from t2twin.core.errors import T2TwinError


def test_documents_are_in_step_with_the_results():
    different = [path.name for path, now in markers.rewritten() if now != path.read_text()]
    assert not different, f"python -m benchmarks --docs would change {different}"


def test_the_documents_bind_figures_of_every_kind():
    text = "".join(path.read_text() for path in markers.documents())
    for name in ("dataset.", "translation.", "latency.", "press.", "dome.", "training.", "probes."):
        assert f"<!--={name}" in text
    for table in tables.TABLES:
        assert f"<!--table {table}-->" in text


# Markers


@pytest.fixture
def page(tmp_path):
    """Writes a README and gives what it is rewritten to."""
    (tmp_path / "docs").mkdir()

    def rewrite(text):
        (tmp_path / "README.md").write_text(text)
        return next(iter(markers.rewritten(tmp_path)))[1]

    return rewrite


def test_a_changed_figure_is_written_anew(page):
    right = page("in <!--=regression.epochs.resnet18 d-->99<!--/--> epochs")
    assert right == "in <!--=regression.epochs.resnet18 d-->12<!--/--> epochs"


def test_a_table_is_written_anew(page):
    assert "| touch2touch |" in page("<!--table results-->\nold\n<!--/table-->\n")


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("a <!--=regression.epochs.alexnet d-->9<!--/-->", "nothing at epochs.alexnet"),
        ("a <!--=nowhere.epochs d-->9<!--/-->", "no nowhere.json"),
        ("a <!--=regression.scale .1f-->9<!--/-->", "cannot be written in the format"),
        ("a <!--=regression.epochs.resnet18 d-->9", "damaged"),
        ("<!--=regression.epochs.resnet18 d-->9<!--/-->", "first in a line"),
        ("    a <!--=regression.epochs.resnet18 d-->9<!--/-->", "block of code"),
        ("<!--table nothing-->\n<!--/table-->\n", "no table 'nothing'"),
    ],
)
def test_a_marker_that_cannot_be_written_is_an_error(page, text, sentence):
    with pytest.raises(T2TwinError, match=f"README.md: .*{sentence}"):
        page(text)


def test_percent_has_a_space():
    assert formatted(0.0197, ".1%") == "2.0 %"
    assert formatted(2995.7, ",.0f") == "2,996"
