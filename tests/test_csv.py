"""Numbers of CSV files of spreadsheets are read right, or refused with their line and column."""

from itertools import product
from pathlib import Path

import pytest

from t2twin.core.errors import T2TwinError
from t2twin.sim.tables import read_csv

READ = {
    "a,b\n1,2\n\n,,\n": ("1", "2"), "\ufeffa,b,,\r\n1,2,,\r\n": ("1", "2"),
    "sep=;\na;b\n1;2\n": ("1", "2"), "\n\na\tb\n1e3\t-.5\n": ("1e3", "-0.5"),
    "a;b\n1,234;0,5\n": ("1.234", "0.5"), "a;b\n1.234;0,5\n": ("1234", "0.5"),
    "a;b\n1.234,5;7\n": ("1234.5", "7"), 'a,b\n"1,234",2.5\n': ("1234", "2.5"),
    'a,b\n"-1,234,567",1.234\n': ("-1234567", "1.234"),
    "a;b\n1'234.5;2\u202f345\n": ("1234.5", "2345"),
}  # fmt: skip
"""Texts of tables, and the numbers of their first row."""


@pytest.mark.parametrize("text", READ)
def test_numbers_are_read_as_they_are_meant(text: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(text.encode())
    names, rows = read_csv(tmp_path / "t.csv", "a|b")
    assert names == ["a", "b"] and tuple(rows[0][1].values()) == READ[text] and len(rows) == 1


CELLS = "1,234", "50 %", "5 N", "€5", "$1,234", "(5)", "nan", "1e999", "−5", "1_0", "12 5", "TRUE"


@pytest.mark.parametrize(("cell", "delimiter"), [("1.234", ";"), *product(CELLS, ",;\t")])
def test_what_may_be_another_number_is_refused(cell: str, delimiter: str, tmp_path: Path) -> None:
    rows = (["b", "a", "note"], ["1", "2", "5 N"], ["3", f'"{cell}"', ""])
    text = "\n".join(delimiter.join(row) for row in rows)
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    with pytest.raises(T2TwinError, match=r"t\.csv, line 3, column a: .*(number|may be 1234 or)"):
        read_csv(tmp_path / "t.csv", "a|b")


def test_advice_has_the_decimal_sign_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("a;b\n1,5;2 N\n")
    with pytest.raises(T2TwinError, match=r"such as 1234,5"):
        read_csv(tmp_path / "t.csv", "a|b")
