"""What earlier runs have left, read at the start: what is used of it, and what is told of the rest."""

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
    exposed_key_files,
    report_damage,
)
from firmware_py.system.store import Store

EARLY_ENDINGS: Final = 3
MOST_SHOWN: Final = 10
STEERING: Final = (
    "AIS_", "CMP", "COG_", "CRUISE_", "CTL_", "EST_", "LOIT_", "LOOP_", "MDL_", "NAV_", "POS_", "RUD_", "STK_", "WP_",
)  # fmt: skip
MOUNTING: Final = (
    "CMP_OFFSET_DEG", "CMPB_OFFSET_DEG", "CMP_DECL_AUTO", "CMP_DECL_DEG", "RUD_CENTRE_DEG", "RUD_LIMIT_DEG",
    "RUD_REVERSE",
)  # fmt: skip


def read_state(directory: Path, store: Store, say: Callable[[str], None]) -> tuple[StateDirectory, Plans]:
    """Return what earlier runs have left; what is wrong with it is said."""
    if store.start_problem:
        say(store.start_problem)
    report_damage(store, say)
    report_key(directory, KeyVault(store).load(), say)
    kept = StateDirectory(store, say)
    plans = kept.plans()
    if store.start_problem:
        say(f"Used of what is stored: {kept.inventory(plans)}")
    kept.count_start()
    return kept, plans


def parameters_to_start_with(
    stored: ParameterSet, vehicle: ParameterSet, early: int, say: Callable[[str], None]
) -> ParameterSet:
    """Return the parameters after so many runs in a row that failed soon after their start.

    After each EARLY_ENDINGS of them control and estimation start with other parameters: those of the vehicle file, then
    the built-in ones. How the devices are mounted stays: the built-in direction of a servo may be the wrong one.
    """
    sets = {stored: "stored"}
    for base, name in ((vehicle, "vehicle file's"), (ParameterSet(), "built-in")):
        values = (
            value if _steers(row) else kept for (row, value), kept in zip(base.items(), stored.values(), strict=True)
        )
        sets.setdefault(ParameterSet(values), name)
    used, name = list(sets.items())[min(early // EARLY_ENDINGS, len(sets) - 1)]
    if used is not stored:
        say(f"{early} starts failed: {name} steering parameters")
        pairs = zip(stored.items(), used.values(), strict=True)
        unused = [f"{row} {format_value(value)}" for (row, value), other in pairs if value != other]
        say(f"Kept, and not used: {', '.join(unused[:MOST_SHOWN])}{', and more' if unused[MOST_SHOWN:] else ''}")
    return used


def _steers(name: str) -> bool:
    """Whether a parameter is one of control or estimation, and says nothing of how the devices are mounted."""
    return name.startswith(STEERING) and not (name in MOUNTING or "_DEV_" in name)


def report_key(directory: Path, stored: Stored, say: Callable[[str], None], *, late: bool = False) -> None:
    """Say what is wrong with the signing key, or that it has come `late`, on a disk that was not there at the start.

    That one was lost is a fault besides, which stands until it is mended.
    """
    finding = find_key(stored)
    if late and finding.state is KeyState.PRESENT:
        say("Signing key is there now, and in force")
    if finding.state is KeyState.LOST:
        say(f"{SIGNING_FILE} lost: {finding.problem}; set or remove the key over a trusted link, or by `rambler key`")
    elif stored.damage:
        say(f"{stored.damage}: {OTHER_SLOT}")
    for name in exposed_key_files(directory):
        say(f"{name} can be read by others; set another key if somebody may have")


def resume(state: State, record: bytes | None, now: Moment, say: Callable[[str], None]) -> State:
    """Return the state at start, going on with the stored record; an unusable one is said and left out."""
    if record is None:
        return state
    try:
        state, notes = restore(state, record, now)
    except (ValueError, RecursionError) as error:
        say(f"stored {RESUME_FILE} left out: {error}")
        return replace(state, greeting="Not resumed: the record is no good")
    for note in notes:
        say(f"stored {RESUME_FILE}: {note}")
    return state
