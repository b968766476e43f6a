"""Reads the stored state of earlier runs at start-up, and reports its problems."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from firmware_py.common.parameters import ParameterSet, format_value
from firmware_py.common.plan import Plans
from firmware_py.common.records import Stored
from firmware_py.core.resume import Moment, restore
from firmware_py.core.state import State
from firmware_py.link.signing import KeyState, find_key
from firmware_py.system.state_directory import (
    OTHER_SLOT,
    RESUME_FILE,
    SIGNING_FILE,
    KeyVault,
    StateDirectory,
    find_exposed_key_files,
    report_damage,
)
from firmware_py.system.store import Store

EARLY_ENDINGS_PER_STAGE: Final = 3  # stages: parameters of the store, of the vehicle file, built in
MAX_REPORTED: Final = 10  # parameters
STEERING_PREFIXES: Final = (
    "AIS_", "CMP", "COG_", "CRUISE_", "CTL_", "EST_", "LOIT_", "LOOP_", "MDL_", "NAV_", "POS_", "RUD_", "STK_", "WP_",
)  # fmt: skip
MOUNTING_PARAMETERS: Final = (
    "CMP_OFFSET_DEG", "CMPB_OFFSET_DEG", "CMP_DECL_AUTO", "CMP_DECL_DEG", "RUD_CENTRE_DEG", "RUD_LIMIT_DEG",
    "RUD_REVERSE",
)  # fmt: skip


def read_state(directory: Path, store: Store, say: Callable[[str], None]) -> tuple[StateDirectory, Plans]:
    """Return the stored state and plans; problems are reported by `say`."""
    if store.start_problem:
        say(store.start_problem)
    report_damage(store, say)
    report_key_problem(directory, KeyVault(store).load(), say)
    stored = StateDirectory(store, say)
    plans = stored.plans()
    if store.start_problem:
        say(f"Loaded from storage: {stored.inventory(plans)}")
    stored.count_start()
    return stored, plans


def select_start_parameters(
    stored: ParameterSet, vehicle: ParameterSet, early_endings: int, say: Callable[[str], None]
) -> ParameterSet:
    """Return the start parameters after `early_endings` consecutive runs that failed soon after their start.

    After each EARLY_ENDINGS_PER_STAGE of them, control and estimation use other parameters: those of the vehicle file,
    then the built-in ones. Mounting parameters stay, because the built-in direction of a servo may be wrong.
    """
    names_by_set = {stored: "stored"}
    for base, name in ((vehicle, "vehicle file's"), (ParameterSet(), "built-in")):
        values = (
            value if _affects_steering(row) else old
            for (row, value), old in zip(base.items(), stored.values(), strict=True)
        )
        names_by_set.setdefault(ParameterSet(values), name)
    used, name = list(names_by_set.items())[min(early_endings // EARLY_ENDINGS_PER_STAGE, len(names_by_set) - 1)]
    if used is not stored:
        say(f"{early_endings} starts failed: {name} steering parameters")
        pairs = zip(stored.items(), used.values(), strict=True)
        unused_values = [f"{row} {format_value(value)}" for (row, value), other in pairs if value != other]
        more = ", and more" if unused_values[MAX_REPORTED:] else ""
        say(f"Stored but not used: {', '.join(unused_values[:MAX_REPORTED])}{more}")
    return used


def _affects_steering(name: str) -> bool:
    """Return whether a parameter belongs to control or estimation and not to the mounting of a device."""
    return name.startswith(STEERING_PREFIXES) and not (name in MOUNTING_PARAMETERS or "_DEV_" in name)


def report_key_problem(directory: Path, stored: Stored, say: Callable[[str], None], *, late: bool = False) -> None:
    """Report problems with the signing key, or that it was loaded from a disk mounted after the start (`late`).

    A lost key is also a fault, which remains set until the key is set or removed.
    """
    finding = find_key(stored)
    if late and finding.state is KeyState.PRESENT:
        say("Signing key loaded and active")
    if finding.state is KeyState.LOST:
        say(f"{SIGNING_FILE} lost: {finding.problem}; set or remove the key over a trusted link or by `rambler key`")
    elif stored.damage:
        say(f"{stored.damage}: {OTHER_SLOT}")
    for name in find_exposed_key_files(directory):
        say(f"{name} is readable by other users; set a new key if they may have read it")


def resume(state: State, record: bytes | None, now: Moment, say: Callable[[str], None]) -> State:
    """Return the start state resumed from the stored record; an invalid record is reported and ignored."""
    if record is None:
        return state
    try:
        state, notes = restore(state, record, now)
    except (ValueError, RecursionError) as error:
        say(f"stored {RESUME_FILE} ignored: {error}")
        return replace(state, greeting="Not resumed: invalid record")
    for note in notes:
        say(f"stored {RESUME_FILE}: {note}")
    return state
