"""Option records whose fields have a range and a description, for checks of files and for the reference pages."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, field, fields
from typing import Any, TypeVar, get_type_hints

import msgspec

RecordT = TypeVar("RecordT")

MISSING_TEXT = " is missing"
_KEY = "option"


class OptionMeaning(msgspec.Struct, frozen=True):
    """Description and range of an option; a text or the items of a list without `choices` are not restricted."""

    text: str
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()


def option(
    text: str,
    *,
    default: Any = MISSING,
    minimum: float = -math.inf,
    maximum: float = math.inf,
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare a field of an options record; without a default it is mandatory."""
    return field(default=default, metadata={_KEY: OptionMeaning(text, minimum, maximum, choices)})


def meanings(kind: type[Any]) -> dict[str, OptionMeaning]:
    """Return the options of a record by name, in order."""
    return {row.name: _meaning_of(row) for row in fields(kind)}


def check(record: Any) -> None:
    """Raise ValueError with a line for each option that is out of range."""
    types = get_type_hints(type(record))
    texts = (_problem_of(getattr(record, row.name), row, types[row.name]) for row in fields(record))
    if problems := [text for text in texts if text]:
        raise ValueError("\n".join(problems))


def _problem_of(value: Any, row: Field[Any], kind: Any) -> str:
    """Return the problem with the value of an option, empty if there is none."""
    meaning = _meaning_of(row)
    if isinstance(value, tuple):
        unknown = [item for item in value if meaning.choices and item not in meaning.choices]
        return (
            f"{row.name}: {unknown[0][:30]!r} is not known; use one of {', '.join(meaning.choices)}" if unknown else ""
        )
    if isinstance(value, str) and meaning.choices and value not in meaning.choices:
        return f"{row.name}: {value[:30]!r} is not known; use one of {', '.join(meaning.choices)}"
    if kind is int and not isinstance(value, int):
        return f"{row.name}: {value} is not a whole number"
    if isinstance(value, (int, float)) and not meaning.minimum <= value <= meaning.maximum:
        return f"{row.name}: {value:g} is out of range; allowed: {meaning.minimum:g} to {meaning.maximum:g}"
    return ""


def record_from(kind: type[RecordT], values: Mapping[str, Any]) -> RecordT:
    """Build an options record from the values of a file, whose names must be options of it.

    Raises ValueError with a line for each option that is missing, of the wrong type or out of range, and if the record
    refuses the values with any other error; TypeError for a record with fields that cannot be read.
    """
    rows = {row.name: row for row in fields(kind)}  # type: ignore[arg-type]
    problems = [f"{name}{MISSING_TEXT}" for name, row in rows.items() if name not in values and row.default is MISSING]
    types = get_type_hints(kind)
    if unreadable := [name for name, row in rows.items() if types[name] not in _READERS or _KEY not in row.metadata]:
        raise TypeError(f"{', '.join(unreadable)}: not declared by option(), or of a type that is not supported")
    checked: dict[str, Any] = {}
    for name, value in values.items():
        try:
            checked[name] = _READERS[types[name]](value, rows[name])
        except ValueError as error:
            problems.append(str(error))
        else:
            problems += filter(None, [_problem_of(checked[name], rows[name], types[name])])
    if problems:
        raise ValueError("\n".join(problems))
    try:
        return kind(**checked)
    except ValueError:
        raise
    except Exception as error:  # noqa: BLE001 - the record may belong to a package of another author
        raise ValueError(f"options refused by the driver: {type(error).__name__}: {error}") from None


def _meaning_of(row: Field[Any]) -> OptionMeaning:
    meaning: OptionMeaning = row.metadata[_KEY]
    return meaning


def _read_text(value: Any, row: Field[Any]) -> str:
    if not isinstance(value, str) or not value:
        raise ValueError(f"{row.name}: expected a text in quotes")
    return value


def _read_flag(value: Any, row: Field[Any]) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{row.name}: expected true or false")  # noqa: TRY004 - ValueError for all problems
    return value


def _read_number(value: Any, row: Field[Any]) -> float:
    try:
        number = math.nan if isinstance(value, (bool, str)) else float(value)
    except (TypeError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        meaning = _meaning_of(row)
        raise ValueError(f"{row.name}: expected a number from {meaning.minimum:g} to {meaning.maximum:g}")
    return number


def _read_integer(value: Any, row: Field[Any]) -> int:
    number = _read_number(value, row)
    if number != int(number):
        raise ValueError(f"{row.name}: {value} is not a whole number")
    return int(number)


def _read_texts(value: Any, row: Field[Any]) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(item, str) and item for item in value):
        raise ValueError(f"{row.name}: expected a list of texts")
    return tuple(value)


_READERS: Mapping[Any, Callable[[Any, Field[Any]], Any]] = {
    str: _read_text,
    bool: _read_flag,
    int: _read_integer,
    float: _read_number,
    float | None: _read_number,
    tuple[str, ...]: _read_texts,
}
