"""Tables of other people's recordings: CSV, Parquet and MATLAB files as named columns, none of them trusted.

A table knows where each of its rows stands in its file, so that whoever finds something wrong can point at it. What a
file claims to hold is bounded before it is read. Nothing here knows what a posture is:
:mod:`bodyimage_kin.recordings.columns` turns columns into a recording.
"""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float, Shaped

from bodyimage_kin.errors import InvalidRecording, MissingDependency, UnknownName
from bodyimage_kin.recordings._matlab import read_matlab

__all__ = ["MOST_BYTES", "MOST_ROWS", "TABLES", "Table", "matching", "read_table"]

MOST_ROWS = 5_000_000
"""Rows of a table; a longer one is refused before it is read."""
MOST_BYTES = 2 << 30
"""Of a file, and of what it unpacks to."""
TABLES = (".csv", ".tsv", ".txt", ".dat", ".parquet", ".mat")
"""Endings of the files that are read as tables."""
_TEXTS = TABLES[:4]
_SEPARATORS = ",;\t"
_HEAD = 1 << 16


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of equal length.

    Attributes:
        name: The file's name.
        columns: Name -> (rows,) values as the file has them: numbers, texts, or objects (arrays of a row).
        row_word: What a row is called: a line of a text, or a record.
        numbers: (rows,) of each row, counted from 1 as that word is.
    """

    name: str
    columns: Mapping[str, Shaped[np.ndarray, "rows"]]
    row_word: str
    numbers: Sequence[int]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def place(self, row: int, column: str) -> str:
        """Where a value stands in its file, in words."""
        return f"'{self.name}', {self.row_word} {self.numbers[row]}, column '{column}'"

    def floats(self, column: str) -> Float[np.ndarray, "rows"]:
        """A column of numbers; NaN where a cell is empty.

        Raises:
            UnknownName: No such column.
            InvalidRecording: A cell that is no number; says which.
        """
        raw = self[column]
        if raw.dtype.kind in "fiu":
            return raw.astype(np.float64)
        values = pd.to_numeric(pd.Series(raw), errors="coerce").to_numpy(dtype=np.float64)
        for row in np.flatnonzero(np.isnan(values)):
            cell = raw[row]
            if not (
                cell is None or (isinstance(cell, float) and np.isnan(cell)) or str(cell).strip().lower() in _EMPTY
            ):
                shown = repr(cell if isinstance(cell, str) else np.asarray(cell).tolist())[:40]
                raise InvalidRecording(f"{self.place(int(row), column)}: {shown} is no number; {_hint(shown)}")
        return values

    def lists(self, column: str) -> list[Float[np.ndarray, "values"]]:
        """A column of lists of numbers: a cell may hold several, one, or none.

        ``name[k]`` takes the k-th entry (from 0) of each row of what a cell holds.

        Raises:
            UnknownName: No such column.
            InvalidRecording: A cell that holds something else.
        """
        name, index = column, None
        if column not in self.columns and (found := re.fullmatch(r"(.+)\[(\d+)\]", column)):
            name, index = found[1], int(found[2])
        cells = []
        for row, cell in enumerate(self[name]):
            try:
                values = np.asarray([] if cell is None else cell, dtype=np.float64)
                if index is not None and values.size:
                    values = np.atleast_2d(values)[:, index]
            except (TypeError, ValueError, IndexError):
                raise InvalidRecording(f"{self.place(row, column)}: no list of numbers") from None
            flat = values.ravel()
            cells.append(flat[~np.isnan(flat)])
        return cells

    def __getitem__(self, column: str) -> Shaped[np.ndarray, "..."]:
        if column not in self.columns:
            raise UnknownName(f"column of '{self.name}'", column, self.columns)
        return self.columns[column]


_EMPTY = ("", "nan", "na", "n/a", "none", "null", "-")


def read_table(
    path: Path,
    *,
    by_position: bool = False,
    variable: str | None = None,
    decimal: str = ".",
    most_rows: int = MOST_ROWS,
) -> Table:
    """A table from a file, by the ending of its name: ``.csv``, ``.tsv``, ``.txt``, ``.parquet`` or ``.mat``.

    Args:
        path: The file.
        by_position: Columns are named "0", "1", ... by where they stand; a header's names are passed over.
        variable: Name of the variable in a MATLAB file; None: the only one.
        decimal: What stands before the decimals in a text.
        most_rows: A longer table is refused before it is read.

    Raises:
        InvalidRecording: A file that is missing, too large, damaged, or of rows that do not fit together; one line that
            says where and what to do.
        MissingDependency: A Parquet file, without pyarrow.
    """
    try:
        size = path.stat().st_size
    except OSError as problem:
        raise InvalidRecording(f"cannot read '{path}': {problem.strerror}") from None
    if size > MOST_BYTES:
        raise InvalidRecording(
            f"'{path.name}' has {size / 2**30:.1f} GB, more than {MOST_BYTES >> 30}; give a part of it"
        )
    if size == 0:
        raise InvalidRecording(f"'{path.name}' is empty")
    suffix = path.suffix.lower()
    if suffix in _TEXTS:
        return _text(path, by_position, decimal, most_rows)
    if suffix == ".parquet":
        return _parquet(path, most_rows)
    if suffix == ".mat":
        return _matlab(path, variable, most_rows)
    raise InvalidRecording(f"'{path.name}': a table ends in .csv, .tsv, .txt, .parquet or .mat; save it as one")


# Text ----------------------------------------------------------------------------------------------------------------


def _text(path: Path, by_position: bool, decimal: str, most_rows: int) -> Table:
    head = _decoded(path, _head(path, _HEAD)).splitlines()
    start = next((number for number, line in enumerate(head) if line.strip() and not line.startswith("#")), None)
    if start is None:
        raise InvalidRecording(f"'{path.name}' has no rows")
    separator = max(_SEPARATORS, key=head[start].count)
    if separator not in head[start]:
        separator = r"\s+" if len(head[start].split()) > 1 else ","
    fields = _split(head[start], separator)
    has_header = not all(map(_is_number, fields))
    begin = start + has_header
    widths = _widths(path, separator, begin, most_rows)
    if not widths.lines:
        raise InvalidRecording(f"'{path.name}' has no rows below its header")
    width = widths.most
    if not by_position and has_header and width != len(fields):
        raise InvalidRecording(
            f"'{path.name}': the header has {len(fields)} names, line {widths.where_most} has {width} values; name "
            "every column in the header, or give columns by position (numbers from 0)"
        )
    if widths.least != width:
        raise InvalidRecording(
            f"'{path.name}', line {widths.where_least} has {widths.least} values, line {widths.where_most} has "
            f"{width}; give every row as many"
        )
    names = fields if has_header and not by_position else [str(number) for number in range(width)]
    if doubled := sorted({name for name in names if names.count(name) > 1}):
        raise InvalidRecording(f"'{path.name}': the header names {doubled[0]!r} twice; give each column its own name")
    try:
        frame = pd.read_csv(
            path, sep=separator, header=None, names=names, skiprows=begin, decimal=decimal, comment="#",
            skip_blank_lines=True, skipinitialspace=True, encoding="utf-8-sig", low_memory=False,
        )  # fmt: skip
    except (ValueError, UnicodeDecodeError, OSError) as problem:
        raise InvalidRecording(f"'{path.name}': {_first_line(problem)}; save it as plain UTF-8 text") from None
    return Table(path.name, {name: frame[name].to_numpy() for name in names}, "line", widths.lines)


@dataclass(frozen=True)
class _Widths:
    """Number of values in the rows of a text: least and most, the lines where they first are, and every row's line."""

    least: int
    where_least: int
    most: int
    where_most: int
    lines: Sequence[int]


def _widths(path: Path, separator: str, begin: int, most_rows: int) -> _Widths:
    least, most, lines = (0, 0), (0, 0), array("q")
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        # A value in quotes may hold anything; then rows are split as the standard library does.
        for number, line in enumerate(file, start=1):
            if number <= begin or not line.strip() or line.startswith("#"):
                continue
            count = _count(line, separator)
            lines.append(number)
            if len(lines) > most_rows:
                raise InvalidRecording(f"'{path.name}' has more than {most_rows:,} rows; give a part of it")
            if len(lines) == 1:
                least = most = (count, number)
            elif count < least[0]:
                least = (count, number)
            elif count > most[0]:
                most = (count, number)
    return _Widths(*least, *most, lines)


def _count(line: str, separator: str) -> int:
    if '"' in line:
        return len(_split(line, separator))
    return len(line.split()) if separator == r"\s+" else line.count(separator) + 1


def _split(line: str, separator: str) -> list[str]:
    if separator == r"\s+":
        return line.split()
    return [field.strip() for field in next(csv.reader([line.rstrip("\r\n")], delimiter=separator), [])]


def _is_number(field: str) -> bool:
    try:
        float(field.replace(",", ".") or "nan")
    except ValueError:
        return False
    return True


def _decoded(path: Path, head: bytes) -> str:
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InvalidRecording(f"'{path.name}' is UTF-16; save it as UTF-8")
    if b"\0" in head:
        raise InvalidRecording(f"'{path.name}' is no text; a table ends in .parquet or .mat where it is one")
    return head.decode("utf-8-sig", errors="replace")


# Parquet -------------------------------------------------------------------------------------------------------------


def _parquet(path: Path, most_rows: int) -> Table:
    try:
        import pyarrow
        import pyarrow.parquet as parquet
    except ImportError:
        raise MissingDependency("a Parquet file needs pyarrow; pip install 'bodyimage-kin[parquet]'") from None
    try:
        file = parquet.ParquetFile(path)
        if file.metadata.num_rows > most_rows:
            raise InvalidRecording(f"'{path.name}' has more than {most_rows:,} rows; give a part of it")
        claimed = sum(file.metadata.row_group(group).total_byte_size for group in range(file.metadata.num_row_groups))
        if claimed > MOST_BYTES:
            raise InvalidRecording(f"'{path.name}' unpacks to {claimed / 2**30:.1f} GB; give a part of it")
        frame = file.read().to_pandas()
    except (pyarrow.ArrowException, OSError, ValueError) as problem:
        raise InvalidRecording(f"'{path.name}' is no Parquet file: {_first_line(problem)}") from None
    return Table(path.name, {str(name): frame[name].to_numpy() for name in frame}, "row", range(1, len(frame) + 1))


# MATLAB --------------------------------------------------------------------------------------------------------------


def _matlab(path: Path, variable: str | None, most_rows: int) -> Table:
    columns = read_matlab(path, variable, MOST_BYTES)
    table = Table(path.name, columns, "record", range(1, len(next(iter(columns.values()), ())) + 1))
    if table.rows == 0:
        raise InvalidRecording(f"'{path.name}' has no records" + (f" in '{variable}'" if variable else ""))
    if table.rows > most_rows:
        raise InvalidRecording(f"'{path.name}' has more than {most_rows:,} rows; give a part of it")
    return table


def _head(path: Path, count: int) -> bytes:
    with path.open("rb") as file:
        return file.read(count)


def _first_line(problem: BaseException) -> str:
    return (str(problem).splitlines() or [type(problem).__name__])[0][:200]


def _hint(shown: str) -> str:
    if re.fullmatch(r"'\s*[-+]?\d+,\d+\s*'", shown):
        return "with decimal commas, give decimal=','"
    return "mend the cell, or leave it empty"


def matching(names: Sequence[str], pattern: str) -> dict[str, str]:
    """Names that a pattern with one ``*`` matches: what stands in its place -> the name, in the order of the names."""
    before, _, after = pattern.partition("*")
    found = {}
    for name in names:
        if len(name) > len(before) + len(after) and name.startswith(before) and name.endswith(after):
            found[name[len(before) : len(name) - len(after) or None]] = name
    return found
