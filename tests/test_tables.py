"""One table as text, in Markdown and in HTML."""

from t2twin.core.tables import NONE, Table, markdown, text
from t2twin.core.templates import environment

TABLE = Table(
    columns=["", "error", "share"],
    groups={
        "": [["a", ("1,200", "900–1,500"), "7 %"], ["bc", ("5", ""), NONE]],
        "Others": [["d", "−3", "1 %"]],
    },
    over=[("val", 2)],
    title="Errors",
    notes=["A note.", "Another."],
)


def test_text_is_aligned_with_intervals_below() -> None:
    assert text(TABLE).splitlines() == [
        "Errors",
        "    val: error  val: share",
        "a        1,200         7 %",
        "     900-1,500            ",
        "bc           5           -",
        "Others",
        "d           -3         1 %",
        "A note.",
        "Another.",
    ]


def test_markdown_has_intervals_in_brackets() -> None:
    assert markdown(TABLE).splitlines() == [
        "Errors",
        "",
        "|  | val: error | val: share |",
        "| --- | --- | --- |",
        "| a | 1,200 (900–1,500) | 7 % |",
        "| bc | 5 | – |",
        "| **Others** |  |  |",
        "| d | −3 | 1 % |",
        "",
        "A note.",
        "",
        "Another.",
    ]


def test_html_has_titles_above_columns_and_of_groups() -> None:
    macros = environment().get_template("report/templates/macros.html").module
    shown = str(macros.table(TABLE))  # pyright: ignore[reportAttributeAccessIssue]
    assert '<th scope="colgroup" colspan="2">val</th>' in shown
    assert '<th scope="rowgroup" colspan="3">Others</th>' in shown
    assert shown.count("<tr") == 2 + 3 + 2 and shown.count('class="span"') == 1
    assert "<td>900–1,500</td><td></td>" in shown
