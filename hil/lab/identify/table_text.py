"""Find the header line and the rows of a table in a text file.

The encoding is UTF-8, UTF-16 with a byte order mark, or Latin-1; gzip is supported. Lines above the header are ignored;
units may follow in the next line. Lines that start with # or % are comments, but may contain the header. Lines below
the last row are ignored.
"""

from __future__ import annotations

import csv
import gzip
import io
import os
import re
import zlib
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast

from firmware_py.files.reading import open_regular
from hil.errors import UsageError
from hil.lab.identify.columns import MANOEUVRE, Column, Layout, columns_of, find_columns, separator_of
from hil.lab.identify.table import MAX_LINES_BELOW

MAX_ROWS = 20_000_000
MAX_BYTES = 2 << 30
MAX_LINE_CHARACTERS = 1 << 18
HEAD_BYTES = 1 << 16
MAX_LINES_ABOVE = 200

COMMENTS = ("#", "%")
_TECPLOT, _ZONE = re.compile(r"\s*variables\s*=", re.IGNORECASE), re.compile(r"\s*zone\b", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
_GZIP_START, _ZIP_START = b"\x1f\x8b", b"PK\x03\x04"  # a ZIP file is a spreadsheet
_CONTROL_BYTES = re.compile(rb"[\x00-\x08\x0e-\x1f]")
_BYTE_PAIR = re.compile(rb"[\x80-\xff]{2}")


@dataclass(frozen=True, slots=True)
class Text:
    """Columns by quantity, line numbers of the rows, cells, and notes."""

    columns: dict[str, Column]
    line_numbers: list[int]
    cells: list[list[str]]
    notes: list[str]


def read_text(path: Path, layout: Layout = MANOEUVRE) -> Text:
    """Read a file of a layout, or raise UsageError with line and remedy."""
    try:
        with ExitStack() as stack:
            return _read_table(path, _open(path, stack), layout)
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise UsageError(f"{path}: its gzip data is damaged; copy or compress it again") from None
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}; give a table (CSV) or an onboard .BIN log") from None
    except UnicodeError:
        raise UsageError(f"{path}: not text; give a table (CSV), or an onboard log whose name ends in .BIN") from None


def _open(path: Path, stack: ExitStack) -> io.TextIOWrapper:
    file: BinaryIO = stack.enter_context(os.fdopen(open_regular(path, max_bytes=MAX_BYTES), "rb"))
    if file.read(len(_GZIP_START)) == _GZIP_START:
        file.seek(0)
        file = cast(BinaryIO, stack.enter_context(gzip.GzipFile(fileobj=file)))
    file.seek(0)
    encoding = _encoding(file.read(HEAD_BYTES))
    file.seek(0)
    return stack.enter_context(io.TextIOWrapper(file, encoding=encoding, newline=""))


def _encoding(head: bytes) -> str:
    """Return the encoding of a text from its beginning; reading reports invalid UTF-8."""
    if head.startswith(_ZIP_START):
        raise UnicodeError
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        head[: head.rfind(b"\n") + 1].decode("utf-8")
    except UnicodeDecodeError:
        if not _CONTROL_BYTES.search(head) and not _BYTE_PAIR.search(head):
            return "latin-1"
    return "utf-8-sig"


def _lines(path: Path, file: io.TextIOWrapper) -> Iterator[str]:
    """Yield lines of limited length; the CSV reader reports a truncated line."""
    remaining = MAX_BYTES
    while line := file.readline(MAX_LINE_CHARACTERS):
        remaining -= len(line)
        if remaining < 0:
            raise UsageError(f"{path}: is larger than {MAX_BYTES >> 20} MiB, uncompressed; split the file")
        yield line


def _read_table(path: Path, file: io.TextIOWrapper, layout: Layout) -> Text:
    above: list[str] = []
    header, separator, header_number = _header(path, file, above, layout)
    columns = columns_of(f"{path}:{header_number}", header, layout)
    text = Text(columns, [], [], [])
    lines_above = sum(1 for line in above[: header_number - 1] if line.strip() and not line.startswith(COMMENTS))
    if lines_above:
        text.notes.append(f"{lines_above} lines above the column names ignored")
    lines = _lines(path, file)
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=separator == " ")
    incomplete: list[tuple[int, int]] = []
    for number, fields in _records(path, reader, header_number):
        if not text.cells and not incomplete and (units := _with_units(header, fields, layout)) is not None:
            text.columns.update(units)
            continue
        if [field.strip() for field in fields] == [field.strip() for field in header]:
            raise UsageError(f"{path}:{number}: the column names are repeated; split the file into one per log")
        if not text.cells and _ZONE.match(fields[0]):
            continue
        if len(fields) != len(header):
            incomplete.append((number, len(fields)))
            if len(incomplete) <= MAX_LINES_BELOW:
                continue
        if incomplete:
            raise UsageError(
                f"{path}:{incomplete[0][0]}: {incomplete[0][1]} fields for {len(header)} column names; "
                "correct or remove the line"
            )
        text.line_numbers.append(number)
        text.cells.append(
            [_with_decimal_point(field) for field in fields] if separator == "," else _with_decimal_points(fields)
        )
        if len(text.cells) > MAX_ROWS:
            raise UsageError(f"{path}: more than {MAX_ROWS} rows; split the file")
    if incomplete and text.cells:
        text.notes.append(f"line {incomplete[0][0]} and the lines below are not complete rows and are ignored")
    return text


def _with_decimal_point(field: str) -> str:
    """Return a field of a table with commas; a quoted number may have a decimal comma."""
    return field.replace(",", ".") if "," in field and _DECIMAL_COMMA.fullmatch(field.strip()) else field


def _with_decimal_points(fields: list[str]) -> list[str]:
    return [field.replace(",", ".") for field in fields]


def _header(path: Path, file: io.TextIOWrapper, above: list[str], layout: Layout) -> tuple[list[str], str, int]:
    """Return fields, separator and number of the line with most column names; the file continues after it.

    All lines that were read are appended to `above`.
    """
    best: tuple[int, list[str], str, int] | None = None
    for line in _lines(path, file):
        above.append(line)
        header_line = line.lstrip("".join(COMMENTS)) if line.startswith(COMMENTS) else line
        if not header_line.strip():
            continue
        separator = separator_of(header_line)
        if _TECPLOT.match(header_line) and '"' in header_line:
            separator, header_line = " ", " ".join(f'"{name}"' for name in header_line.split('"')[1::2])
        fields = next(_records(path, csv.reader([header_line], delimiter=separator, skipinitialspace=True), 0))[1]
        columns = find_columns(fields, layout)
        count = len(columns) if not line.startswith(COMMENTS) or not layout.missing(columns) else -1
        if best is None or count > best[0]:
            best = (count, fields, separator, len(above))
        if not layout.missing(columns) or len(above) >= MAX_LINES_ABOVE:
            break
    names = ",".join(layout.names)
    if best is None or best[0] < 0:
        raise UsageError(f"{path}: empty; the first line must name the columns {names}")
    if header_line.startswith(("$", "!")) and best[0] == 0:
        raise UsageError(
            f"{path}: NMEA 0183 sentences instead of a table; give a table with the columns {','.join(layout.names)}"
        )
    return best[1:]


def _with_units(header: list[str], fields: list[str], layout: Layout) -> dict[str, Column] | None:
    """Return the columns with the units of a separate line; None if it contains numbers or is empty."""
    if len(fields) != len(header) or any(character.isdigit() for field in fields for character in field):
        return None
    if not any(field.strip() for field in fields):
        return None
    both = [f"{name} {unit}" for name, unit in zip(header, fields, strict=True)]
    with_units = find_columns(both, layout)
    return columns_of("", both, layout) if with_units.keys() == find_columns(header, layout).keys() else {}


def _records(path: Path, reader: Iterator[list[str]], previous_number: int) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and fields of every line that is not empty."""
    number = previous_number
    while True:
        try:
            fields = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise UsageError(f"{path}:{number + 1}: not a CSV file ({error}); export it again") from None
        number += 1
        if any(field.strip() for field in fields) and not fields[0].lstrip().startswith(COMMENTS):
            yield number, fields
