"""Reads CSV files of spreadsheets."""

import csv
import io
import re
from collections.abc import Iterable
from dataclasses import MISSING, fields
from math import isfinite
from pathlib import Path
from typing import TypeVar

from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.core.records import check_names, convert

Record = TypeVar("Record")

DELIMITERS = ",;\t"  # of columns; spreadsheets of many countries write the second
SIGNS = {".": ",", ",": "."}  # decimal signs, and the sign of thousands that goes with each
AMBIGUOUS = re.compile(r"[-+]?[1-9][0-9]{0,2}[.,][0-9]{3}")  # 1,234 is 1234 or 1.234


def read_csv(path: Path, numbers: str) -> tuple[list[str], list[tuple[str, dict[str, str]]]]:
    """The names of the columns; of each row its place, such as "line 2", and its nonempty cells.

    The delimiter is the most frequent one in the first line. numbers: pattern of the names of the
    columns of numbers, which are returned as Python writes them. Raises T2TwinError, with line and
    column, for a cell there that is no finite number, or that may be one of two.
    """
    try:
        text = read_file(path).decode("utf-8-sig")
        text = re.sub(r"\Asep=.(?=\r?\n)", "", text)  # an instruction to a spreadsheet
        delimiter = max(DELIMITERS, key=text.lstrip("\r\n").partition("\n")[0].count)
        if text.count('"') % 2:  # the reader would take all that follows for one cell
            raise csv.Error("a quotation mark is not closed")
        reader = csv.reader(
            io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True
        )
        lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        raise T2TwinError(f"{path} cannot be read as a CSV table ({error})") from error
    lines = [(number, cells) for number, cells in lines if any(cells)]
    if not lines:
        raise T2TwinError(f"{path} is empty; expected a CSV table")
    (_, names), *others = lines
    while not names[-1]:  # columns without a name or a cell
        names.pop()
    rows = []
    for number, cells in others:
        if len(cells) < len(names) or any(cells[len(names) :]):
            raise T2TwinError(f"{path}, line {number}: {len(cells)} cells in {len(names)} columns")
        pairs = zip(names, cells, strict=False)
        rows.append((f"line {number}", {name: cell for name, cell in pairs if cell}))
    own = [name for name in names if re.fullmatch(numbers, name)]
    sign = _decimal_sign(row[name] for _, row in rows for name in own if name in row)
    for place, row in rows:
        for name in own:
            if name in row:
                source = f"{path}, {place}, column {name}"
                row[name] = _plain(row[name], sign, source, ",." if delimiter == ";" else ",")
    return names, rows


def _decimal_sign(cells: Iterable[str]) -> str | None:
    """The decimal sign of the numbers of a file; None where no cell shows it."""
    for cell in cells:
        first, *others = re.findall("[.,]", cell) or [""]
        if first and not AMBIGUOUS.fullmatch(cell):
            # The last of two signs; the other one of a sign that returns; the only sign.
            return others[-1] if {*others} - {first} else SIGNS[first] if others else first
    return None


def _plain(cell: str, sign: str | None, source: str, doubtful: str) -> str:
    """A number as Python writes it. doubtful: signs that may be of thousands without a sign."""
    if sign is None and AMBIGUOUS.fullmatch(cell) and {*cell} & {*doubtful}:
        whole, decimal = re.sub("[.,]", "", cell), cell.replace(",", ".")
        raise T2TwinError(
            f"{source}: {cell} may be {whole} or {decimal}; write {whole} or {decimal}0"
        )
    point, of_file = sign or ".", f" with the decimal sign {sign} of this file" if sign else ""
    groups = rf"[0-9]{{1,3}}(?:[{SIGNS[point]}' \u00a0\u202f\u2019][0-9]{{3}})+"
    found = re.fullmatch(rf"([-+]?)({groups}|[0-9]*)[{point}]?([0-9]*)(e[-+]?[0-9]+)?", cell, re.I)
    if found is not None and (found[2] or found[3]):
        whole = re.sub("[^0-9]", "", found[2]) or "0"
        plain = f"{found[1].strip('+')}{whole}{found[3] and '.'}{found[3]}{found[4] or ''}"
        if isfinite(float(plain)):
            return plain
    raise T2TwinError(
        f"{source}: {cell[:40]!r} is no finite number{of_file}; expected one such as 1234{point}5, "
        "without a unit or a percent sign"
    )


def read_rows(path: Path, kind: type[Record]) -> tuple[Record, ...]:
    """The rows of a CSV file. kind: a dataclass whose fields are the columns, defaults of empty
    cells. Raises T2TwinError, with the line, for other columns and values that do not fit."""
    known = fields(kind)  # pyright: ignore[reportArgumentType]
    numbers = "|".join(field.name for field in known if field.type is not str)
    names, rows = read_csv(path, numbers)
    check_names(names, [field.name for field in known], path)
    for field in known:
        if field.default is MISSING and field.name not in names:
            raise T2TwinError(f"{path} has no column {field.name}; it has {', '.join(names)}")
    return tuple(
        convert(cells, kind, f"{path}, {place}", strict=False, row=True) for place, cells in rows
    )
