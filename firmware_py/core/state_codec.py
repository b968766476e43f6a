"""Encode and decode the state between ticks as text, bit for bit, for the checkpoints of the log.

Faults and parameters are written by name. A fault that is missing is not active; an unknown one is ignored and
reported. A parameter that is missing or no longer valid takes its default. common/record_codec.py decodes other fields,
and renamed ones.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from firmware_py.common import plan, record_codec
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan
from firmware_py.common.reading_notes import Location, abbreviate, check_number
from firmware_py.common.record_codec import Hooks
from firmware_py.core.state import State
from firmware_py.faults.latch import LatchState
from firmware_py.faults.table import Fault
from firmware_py.safety.failsafe import FailsafeState

VERSION: Final = 9  # of the records in State; early development versions had 1 to 6


def state_to_text(state: State) -> str:
    """Return a state as one line of text."""
    plain = record_codec.to_plain(state, VERSION, HOOKS)
    _name_times(plain["fault_latch"], "since_s", "last_present_s")
    _name_bits(plain["fault_latch"], "active")
    failsafe = plain["supervisor"]["failsafe"]
    _name_bits(failsafe, "active", "calling")
    if failsafe["fault"] is not None:
        failsafe["fault"] = Fault(failsafe["fault"]).name
    return record_codec.text_of(plain)


def state_from_text(text: str) -> tuple[State, tuple[str, ...]]:
    """Return the state and notes on ignored parts; ValueError if the text is not a state."""
    return record_codec.from_text(State, text, VERSION, HOOKS)


def _name_times(plain: dict[str, Any], *fields: str) -> None:
    """Replace lists of times by dictionaries with fault names as keys, in place."""
    for field in fields:
        times = plain[field]
        plain[field] = {fault.name: times[fault] for fault in Fault if times[fault] is not None}


def _name_bits(plain: dict[str, Any], *fields: str) -> None:
    """Replace bit fields by lists of fault names, in place."""
    for field in fields:
        bits = plain[field]
        plain[field] = [fault.name for fault in Fault if bits >> fault & 1]


def _known_faults(names: Iterable[Any], location: Location) -> list[Fault]:
    """Return the faults with these names; unknown names are reported."""
    faults = []
    for name in names:
        if isinstance(name, str) and name in Fault.__members__:
            faults.append(Fault[name])
        else:
            location.note(f"fault {abbreviate(name)} is not known here, ignored")
    return faults


def _number_times(plain: dict[str, Any], location: Location, *fields: str) -> None:
    """Replace dictionaries with fault names as keys by lists of times, in place."""
    for field in fields:
        by_name = plain.get(field)
        if isinstance(by_name, dict):
            times: list[Any] = [None] * len(Fault)
            for fault in _known_faults(by_name, location.field(field)):
                times[fault] = by_name[fault.name]
            plain[field] = times
        elif field in plain:
            plain[field] = None  # refused by the decoder


def _number_bits(plain: dict[str, Any], location: Location, *fields: str) -> None:
    """Replace lists of fault names by bit fields, in place."""
    for field in fields:
        names = plain.get(field)
        if isinstance(names, list):
            plain[field] = sum(1 << fault for fault in set(_known_faults(names, location.field(field))))
        elif field in plain:
            plain[field] = None  # refused by the decoder


def _prepare_latch(plain: dict[str, Any], location: Location) -> None:
    _number_times(plain, location, "since_s", "last_present_s")
    _number_bits(plain, location, "active")


def _prepare_failsafe(plain: dict[str, Any], location: Location) -> None:
    _number_bits(plain, location, "active", "calling")
    if (name := plain.get("fault")) is not None:
        plain["fault"] = next(iter(_known_faults([name], location.field("fault"))), None)


def _prepare_parameters(plain: Any, location: Location) -> None:
    """Remove and report parameters that are unknown or invalid."""
    for name, value in list(plain.items()) if isinstance(plain, dict) else ():
        if name not in INDEX:
            location.note(f"parameter {abbreviate(name)} is not known here, ignored")
            del plain[name]
            continue
        try:
            plain[name] = TABLE[INDEX[name]].check(check_number(value))
        except ValueError as error:
            location.note(f"{'' if isinstance(error, ParameterError) else f'{name}: '}{error}; its default is taken")
            del plain[name]


def _encode(value: Any) -> Any:
    if isinstance(value, ParameterSet):
        return dict(value.items())
    if isinstance(value, Plan):
        return plan.as_plain(value)
    raise TypeError(f"{type(value).__name__} cannot be encoded")


def _decode(kind: type, plain: Any) -> Any:
    if kind is Plan:
        return plan.from_plain(plain)
    if not isinstance(plain, dict):
        raise ValueError(f"expected parameters by name, found {abbreviate(plain)}")  # noqa: TRY004 -- bad data
    return ParameterSet([plain.get(row.name, row.default) for row in TABLE])  # checked before


HOOKS: Final = Hooks(
    _encode,
    _decode,
    {
        LatchState: _prepare_latch,
        FailsafeState: _prepare_failsafe,
        ParameterSet: _prepare_parameters,
        Plan: plan.note_unknown,
    },
)
