"""Finds in a text, of whatever encoding, the line that names the columns of a table, and the rows below it.

Text is UTF-8, or UTF-16 with its mark, or of one byte a character (the degree sign of an older program); it may be
packed by gzip. What stands above the names is passed over; units may stand in a line of their own below them. Lines
that begin with # or % are comments, but the names may stand in one. What stands below the last row is left out.
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
from hil.lab.identify.columns import MANOEUVRE, Column, Layout, columns_of, found_columns, separator_of
from hil.lab.identify.table import MOST_LINES_BELOW

MOST_ROWS = 20_000_000
MOST_BYTES = 2 << 30
LONGEST_LINE = 1 << 18
LOOKED_AT_BYTES = 1 << 16
MOST_LINES_ABOVE = 200

COMMENTS = ("#", "%")
_TECPLOT, _ZONE = re.compile(r"\s*variables\s*=", re.IGNORECASE), re.compile(r"\s*zone\b", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
_GZIP, _ZIP = b"\x1f\x8b", b"PK\x03\x04"  # the latter of a spreadsheet
_NO_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1f]")
_BYTES_TOGETHER = re.compile(rb"[\x80-\xff]{2}")


@dataclass(frozen=True, slots=True)
class Text:
    """The columns, the numbers of the rows' lines, the cells, and notes."""

    places: dict[str, Column]
    numbers: list[int]
    cells: list[list[str]]
    notes: list[str]


def read_text(path: Path, layout: Layout = MANOEUVRE) -> Text:
    """Read a file of a layout; UsageError names the line and the remedy."""
    try:
        with ExitStack() as opened:
            return _table(path, _opened(path, opened), layout)
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise UsageError(f"{path}: its gzip packing is damaged; pack or copy it anew") from None
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}; give a table (CSV) or an onboard .BIN log") from None
    except UnicodeError:
        raise UsageError(f"{path}: not text; give a table (CSV), or an onboard log whose name ends in .BIN") from None


def _opened(path: Path, opened: ExitStack) -> io.TextIOWrapper:
    file: BinaryIO = opened.enter_context(os.fdopen(open_regular(path, max_bytes=MOST_BYTES), "rb"))
    if file.read(len(_GZIP)) == _GZIP:
        file.seek(0)
        file = cast(BinaryIO, opened.enter_context(gzip.GzipFile(fileobj=file)))
    file.seek(0)
    encoding = _encoding(file.read(LOOKED_AT_BYTES))
    file.seek(0)
    return opened.enter_context(io.TextIOWrapper(file, encoding=encoding, newline=""))


def _encoding(begin: bytes) -> str:
    """Return what a text is written in; as UTF-8 it is refused later where it is none."""
    if begin.startswith(_ZIP):
        raise UnicodeError
    if begin.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        begin[: begin.rfind(b"\n") + 1].decode("utf-8")
    except UnicodeDecodeError:
        if not _NO_TEXT.search(begin) and not _BYTES_TOGETHER.search(begin):
            return "latin-1"
    return "utf-8-sig"


def _lines(path: Path, file: io.TextIOWrapper) -> Iterator[str]:
    """Yield lines; none is read without end, and one that is cut here is refused for the length of its field."""
    left = MOST_BYTES
    while line := file.readline(LONGEST_LINE):
        left -= len(line)
        if left < 0:
            raise UsageError(f"{path}: is larger than {MOST_BYTES >> 20} MiB, unpacked; cut the file")
        yield line


def _table(path: Path, file: io.TextIOWrapper, layout: Layout) -> Text:
    above: list[str] = []
    header, separator, at = _header(path, file, above, layout)
    places = columns_of(f"{path}:{at}", header, layout)
    text = Text(places, [], [], [])
    passed = sum(1 for line in above[: at - 1] if line.strip() and not line.startswith(COMMENTS))
    if passed:
        text.notes.append(f"{passed} lines above the column names are passed over")
    lines = _lines(path, file)
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=separator == " ")
    odd: list[tuple[int, int]] = []
    for number, fields in _records(path, reader, at):
        if not text.cells and not odd and (units := _with_units(header, fields, layout)) is not None:
            text.places.update(units)
            continue
        if [field.strip() for field in fields] == [field.strip() for field in header]:
            raise UsageError(f"{path}:{number}: the column names stand there again: make a file of each of the logs")
        if not text.cells and _ZONE.match(fields[0]):
            continue
        if len(fields) != len(header):
            odd.append((number, len(fields)))
            if len(odd) <= MOST_LINES_BELOW:
                continue
        if odd:
            raise UsageError(
                f"{path}:{odd[0][0]}: {odd[0][1]} fields under {len(header)} column names; mend or remove the line"
            )
        text.numbers.append(number)
        text.cells.append([_number(field) for field in fields] if separator == "," else _with_points(fields))
        if len(text.cells) > MOST_ROWS:
            raise UsageError(f"{path}: more than {MOST_ROWS} rows; cut the file")
    if odd and text.cells:
        text.notes.append(f"line {odd[0][0]} and what is below it are no whole rows, and left out")
    return text


def _number(field: str) -> str:
    """Return a field between commas; a quoted number may have a decimal comma."""
    return field.replace(",", ".") if "," in field and _DECIMAL_COMMA.fullmatch(field.strip()) else field


def _with_points(fields: list[str]) -> list[str]:
    return [field.replace(",", ".") for field in fields]


def _header(path: Path, file: io.TextIOWrapper, above: list[str], layout: Layout) -> tuple[list[str], str, int]:
    """Return the fields of the line that names most columns, what separates them, and its number; leave off behind it.

    above: all lines that were read to find it.
    """
    best: tuple[int, list[str], str, int] | None = None
    for line in _lines(path, file):
        above.append(line)
        bare = line.lstrip("".join(COMMENTS)) if line.startswith(COMMENTS) else line
        if not bare.strip():
            continue
        separator = separator_of(bare)
        if _TECPLOT.match(bare) and '"' in bare:
            separator, bare = " ", " ".join(f'"{name}"' for name in bare.split('"')[1::2])
        fields = next(_records(path, csv.reader([bare], delimiter=separator, skipinitialspace=True), 0))[1]
        found = found_columns(fields, layout)
        count = len(found) if not line.startswith(COMMENTS) or not layout.missing(found) else -1
        if best is None or count > best[0]:
            best = (count, fields, separator, len(above))
        if not layout.missing(found) or len(above) >= MOST_LINES_ABOVE:
            break
    names = ",".join(layout.names)
    if best is None or best[0] < 0:
        raise UsageError(f"{path}: empty; the first line must name the columns {names}")
    if bare.startswith(("$", "!")) and best[0] == 0:
        raise UsageError(
            f"{path}: sentences of NMEA 0183, no table; make one with the columns {','.join(layout.names)}"
        )
    return best[1:]


def _with_units(header: list[str], fields: list[str], layout: Layout) -> dict[str, Column] | None:
    """Return the columns with the units that stand in a line of their own; None if there are numbers in it."""
    if len(fields) != len(header) or any(character.isdigit() for field in fields for character in field):
        return None
    if not any(field.strip() for field in fields):
        return None
    both = [f"{name} {unit}" for name, unit in zip(header, fields, strict=True)]
    known = found_columns(both, layout)
    return columns_of("", both, layout) if known.keys() == found_columns(header, layout).keys() else {}


def _records(path: Path, reader: Iterator[list[str]], before: int) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and fields of every line that says something."""
    number = before
    while True:
        try:
            fields = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise UsageError(f"{path}:{number + 1}: not a CSV file ({error}); export it anew") from None
        number += 1
        if any(field.strip() for field in fields) and not fields[0].lstrip().startswith(COMMENTS):
            yield number, fields
