"""One table as text, in Markdown and in HTML."""

from t2twin.core.tables import NONE, Table, markdown, text
from t2twin.core.templates import environment

TABLE = Table(
    columns=["", "error", "share"],
    groups={
        "": [["a", "1,200 (900–1,500)", "7 %"], ["bc", "5", NONE]],
        "Others": [["d", "−3", "1 %"]],
    },
    title="Errors",
    notes=["A note.", "Another."],
)


def test_text_is_aligned() -> None:
    assert text(TABLE).splitlines() == [
        "Errors",
        "                error  share",
        "a   1,200 (900-1,500)    7 %",
        "bc                  5      -",
        "Others",
        "d                  -3    1 %",
        "A note.",
        "Another.",
    ]


def test_markdown() -> None:
    title, table, *notes = markdown(TABLE).strip().split("\n\n")
    assert (title, notes) == ("Errors", ["A note.", "Another."])
    assert table.splitlines() == [
        "|  | error | share |",
        "| --- | --- | --- |",
        "| a | 1,200 (900–1,500) | 7 % |",
        "| bc | 5 | – |",
        "| **Others** |  |  |",
        "| d | −3 | 1 % |",
    ]


def test_html_has_titles_and_notes() -> None:
    macros = environment().get_template("report/templates/macros.html").module
    shown = str(macros.table(TABLE))  # pyright: ignore[reportAttributeAccessIssue]
    assert '<th scope="rowgroup" colspan="3">Others</th>' in shown
    assert shown.count("<tr") == 1 + 2 + 2 and "<td>1,200 (900–1,500)</td>" in shown
    assert "<b>Errors</b>" in shown and "A note. Another." in shown
