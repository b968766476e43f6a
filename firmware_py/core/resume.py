"""What of the state outlives a restart: mode, goal, mission and where the boat was about to go.

The moment when it was written tells how old it is. Everything else in it is a duration: the clock of a process begins
anew.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec
from msgspec.structs import fields, replace

from firmware_py.common import record_codec
from firmware_py.common.mode_table import Mode
from firmware_py.common.reports import Home
from firmware_py.core import last_place
from firmware_py.core.last_place import LastPlace
from firmware_py.core.state import State
from firmware_py.core.state_codec import VERSION
from firmware_py.estimate import heading_estimator, water
from firmware_py.faults.table import TABLE
from firmware_py.guidance.guidance import GuidanceState, take_changes
from firmware_py.guidance.line import LineState
from firmware_py.guidance.mission_progress import MissionProgress, is_halted
from firmware_py.guidance.orbit import OrbitState
from firmware_py.guidance.task_follower import TaskFollowerState
from firmware_py.guidance.tasks import Task
from firmware_py.modes import ModeState

# Finer changes are not seen.
ELAPSED_STEP_S, TURNED_STEP_RAD, CURRENT_STEP_M_S = 30.0, 0.2, 0.1
NOTHING, ALL_BUT_ARMING, ALL = 0, 1, 2  # BOOT_RESUME


class Moment(msgspec.Struct, frozen=True):
    """A moment by the computer's clocks: the calendar, which may be wrong, and the monotonic one of its run `boot`.

    An empty `boot` is one that nobody knows.
    """

    utc_s: float
    boot: str = ""
    machine_s: float = 0.0

    def at(self, t_s: float, utc_s: float) -> Moment:
        """Return the moment t_s after this one, when the calendar says utc_s."""
        return Moment(utc_s, self.boot, self.machine_s + t_s)


class Resume(msgspec.Struct, frozen=True):
    """What is kept; the first three say when, as a `Moment` does."""

    utc_s: float
    modes: ModeState
    mission: MissionProgress
    task: Task | None = None
    arrived: bool = False
    line: LineState | None = None
    orbit: OrbitState = OrbitState()
    fence_enabled: bool | None = None
    home: Home | None = None
    water: tuple[float, float, float] | None = None  # current north and east, speed; None: as at start
    place: LastPlace | None = None
    boot: str = ""
    machine_s: float = 0.0


def resume_of(state: State, now: Moment) -> Resume:
    """Return what is to be kept of a state."""
    # As the next tick will take it up: an order is on disk before that.
    nav = take_changes(state.guidance, state.modes, state.plans)
    return Resume(
        now.utc_s,
        replace(_lasting_modes(state), stick=None, stick_t_s=0.0, bench=None, bench_until_s=0.0),
        replace(nav.mission, elapsed_s=_rounded(nav.mission.elapsed_s, ELAPSED_STEP_S), idle_items=0),
        nav.task,
        nav.follower.arrived,
        _line_at_start(nav.follower.line),
        OrbitState(None, _rounded(nav.follower.orbit.turned_rad, TURNED_STEP_RAD)),
        nav.fence_enabled,
        state.home,
        _expected_water(state),
        last_place.of_state(state.position, state.heading_estimator.water),
        now.boot,
        now.machine_s,
    )


def _lasting_modes(state: State) -> ModeState:
    """Return mode and goal: those before a failsafe after which she goes on in any case."""
    supervisor = state.supervisor
    fault, before = supervisor.failsafe.fault, supervisor.goes_on_with(resume=bool(state.parameters["FS_RESUME"]))
    if fault is None or before is None or not TABLE[fault].always_resumes:
        return state.modes
    return replace(state.modes, mode=before.mode, goal=before.goal, by_failsafe=before.by_failsafe)


def _expected_water(state: State) -> tuple[float, float, float]:
    north_m_s, east_m_s, speed_m_s, _ = water.known(state.heading_estimator.water)
    step = CURRENT_STEP_M_S
    return _rounded(north_m_s, step), _rounded(east_m_s, step), _rounded(speed_m_s, step)


def _rounded(value: float, step: float) -> float:
    return math.floor(value / step) * step


def to_bytes(resume: Resume) -> bytes:
    """Return the record as it is stored."""
    return record_codec.encode(resume, VERSION)


def from_bytes(data: bytes) -> tuple[Resume, tuple[str, ...]]:
    """Return a stored record, and notes on what was ignored.

    ValueError for one that lacks what it needs, or has numbers that no state can hold.
    """
    resume, notes = record_codec.decode(Resume, data, VERSION)
    line = resume.line  # of which only the start is taken, and a count
    if not _finite(replace(resume, line=None)) or (line is not None and not _finite(line.start)):
        raise ValueError("a number of it is not one")
    return resume, notes


def _line_at_start(line: LineState | None) -> LineState | None:
    """Return what is kept of following a line: the rest is of the run before."""
    return None if line is None else LineState(line.start, tries=line.tries)


def _finite(value: Any) -> bool:
    """Whether every number of a record is one, at any depth."""
    if isinstance(value, msgspec.Struct):
        return all(_finite(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, tuple):
        return all(map(_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def _within_boot_s(resume: Resume, now: Moment) -> float | None:
    """Return how long ago the record was written, None when the computer has not run on since."""
    is_same = now.boot and resume.boot == now.boot and resume.machine_s <= now.machine_s
    return now.machine_s - resume.machine_s if is_same else None


def _by_calendar_s(resume: Resume, now: Moment) -> float | None:
    """Return how long ago the record was written, None when the calendar clock cannot have been right."""
    age_s = now.utc_s - resume.utc_s
    return age_s if 0.0 <= age_s < 3.2e8 else None


def restore(state: State, data: bytes, now: Moment) -> tuple[State, tuple[str, ...]]:
    """Return the state at start that goes on with what was kept, and notes on what was ignored.

    The greeting of the state says when something was ignored. ValueError for data that are no record.
    """
    level = int(state.parameters["BOOT_RESUME"])
    if level == NOTHING:
        return state, ()
    resume, notes = from_bytes(data)
    away_s = _within_boot_s(resume, now)
    age_s = _by_calendar_s(resume, now) if away_s is None else away_s
    if age_s is not None and age_s > 3600.0 * state.parameters["BOOT_RESUME_H"]:
        return replace(state, greeting=f"Not resumed: {_age_text(age_s)} old"), notes
    if resume.place is not None:
        try:
            state = replace(state, position=last_place.restored(resume.place, away_s))
        except ValueError as error:
            notes += (f"Resume.place left out: {error}",)
            resume = replace(resume, place=None)
    armed = resume.modes.armed if level == ALL else state.modes.armed
    expected = resume.water if resume.place is None else last_place.water_of(resume.place)
    follower = TaskFollowerState(resume.task, resume.arrived, _line_at_start(resume.line), orbit=resume.orbit)
    nav = GuidanceState(
        resume.modes.mode,
        resume.modes.armed and armed,
        resume.mission,
        resume.task,
        follower,
        fence_enabled=resume.fence_enabled,
    )
    halted = ", paused" if resume.modes.mode is Mode.AUTO and is_halted(resume.mission) else ""
    greeting = (
        f"Resumed {resume.modes.mode.name}{halted}, {'age unknown' if age_s is None else _age_text(age_s) + ' old'}"
    )
    state = replace(
        state,
        modes=replace(resume.modes, armed=armed),
        guidance=nav,
        home=resume.home,
        heading_estimator=state.heading_estimator
        if expected is None
        else heading_estimator.expecting(state.heading_estimator, expected),
        greeting=greeting + (", not whole" if notes else ""),
    )
    return state, notes


def _age_text(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.0f} h"
