"""Sets of parameter values, and parameter files of ground stations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from firmware_py.common.parameter_row import SINGLE_MAX, ParameterError, to_single
from firmware_py.common.parameter_table import INDEX, TABLE

MAX_NAME_LENGTH = 16
MAX_PROBLEMS = 20  # reported for one file
_WORDS_BY_NAME: Mapping[str, frozenset[str]] = {name: frozenset(name.split("_")) for name in INDEX}


class ParameterSet:
    """An immutable value for every row of TABLE, hashable and compared by value."""

    __slots__ = ("_hash", "_values")

    def __init__(self, values: Iterable[float] | None = None) -> None:
        """Create a set from checked values in the order of the table, or with the defaults."""
        self._values = tuple(row.default for row in TABLE) if values is None else tuple(values)
        if len(self._values) != len(TABLE):
            raise ParameterError(f"{len(self._values)} values for {len(TABLE)} parameters")
        self._hash = hash(self._values)

    def __getitem__(self, name: str) -> float:
        """Return the value of a row; ParameterError for an unknown name."""
        return self._values[index_of(name)]

    def __eq__(self, other: object) -> bool:
        """Compare by value."""
        return isinstance(other, ParameterSet) and self._values == other._values

    def __hash__(self) -> int:
        """Hash by value."""
        return self._hash

    def items(self) -> Iterator[tuple[str, float]]:
        """Yield name and value in the table's order."""
        for row, value in zip(TABLE, self._values, strict=True):
            yield row.name, value

    def values(self) -> tuple[float, ...]:
        """Return the values in the table's order."""
        return self._values

    def replaced(self, name: str, value: float) -> ParameterSet:
        """Return a set with one value changed, or raise ParameterError."""
        index = index_of(name)
        checked = TABLE[index].check(value)
        if checked == self._values[index]:
            return self
        return ParameterSet((*self._values[:index], checked, *self._values[index + 1 :]))


def index_of(name: str) -> int:
    """Return the row number of a name, or raise ParameterError with similar names."""
    index = INDEX.get(name)
    if index is None:
        raise ParameterError(f"unknown parameter {name[:30]!r}; near it: {', '.join(similar_names(name))}")
    return index


def similar_names(name: str) -> tuple[str, ...]:
    """Return the three most similar names of the table: by common words, then by common prefix."""
    upper_name = name[:MAX_NAME_LENGTH].upper()
    words = frozenset(upper_name.split("_"))
    similarity = {
        row: (-len(words & _WORDS_BY_NAME[row]), -_common_prefix_length(row, upper_name), row) for row in INDEX
    }
    return tuple(sorted(INDEX, key=similarity.__getitem__)[:3])


def _common_prefix_length(first: str, second: str) -> int:
    count = 0
    for left, right in zip(first, second, strict=False):
        if left != right:
            break
        count += 1
    return count


def parse_file(text: str, source: str) -> dict[str, float]:
    """Read a parameter file of a ground station into {name: checked value}.

    Accepts the formats of MAVProxy and Mission Planner (`NAME VALUE` or `NAME,VALUE`) and of QGroundControl (`SYSTEM
    COMPONENT NAME VALUE TYPE`); `#` starts a comment. Raises ParameterError with source, line number and reason for
    each invalid line.
    """
    values: dict[str, float] = {}
    problems: list[str] = []
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.partition("#")[0].replace(",", " ").split()
        if not fields:
            continue
        try:
            name, value = _parse_name_and_value(fields, line)
            values[name] = TABLE[index_of(name)].check(value)
        except ParameterError as error:
            problems.append(f"{source}:{number}: {error}")
            if len(problems) == MAX_PROBLEMS:
                problems.append(f"{source}: not checked after line {number}")
                break
    if problems:
        raise ParameterError("\n".join(problems))
    return values


def _parse_name_and_value(fields: Sequence[str], line: str) -> tuple[str, float]:
    if len(fields) not in (2, 5):
        raise ParameterError(f"expected NAME VALUE, found {line.strip()[:60]!r}")
    name, text = (fields[2], fields[3]) if len(fields) == 5 else fields
    try:
        return name, float(text)
    except ValueError:
        raise ParameterError(f"{text[:30]!r} is not a number") from None


def format_value(value: float) -> str:
    """Write a value with the fewest digits that read back as the same single."""
    if value == math.floor(value) and abs(value) < 1e9:
        return str(int(value))
    for digits in range(1, 10):
        text = f"{value:.{digits}g}"
        # The largest singles may be rounded up beyond the range.
        if abs(float(text)) <= SINGLE_MAX and to_single(float(text)) == value:
            return text
    return repr(value)


def format_file(values: Mapping[str, float]) -> str:
    """Write a `NAME VALUE` file that parse_file and the ground stations read."""
    return "".join(f"{name} {format_value(value)}\n" for name, value in values.items())
