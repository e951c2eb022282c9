"""One table as text and in Markdown."""

from t2twin.core.tables import NONE, Table, markdown, text

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
