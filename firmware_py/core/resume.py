"""Resume record: mode, goal, mission, task and position for a restart.

The record contains the time of its writing, which gives its age. All other times in it are durations, because the clock
of a process starts at 0.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec
from msgspec.structs import fields, replace

from firmware_py.common import record_codec
from firmware_py.common.mode_table import Mode
from firmware_py.common.reports import Home
from firmware_py.core import last_position
from firmware_py.core.last_position import LastPosition
from firmware_py.core.state import State
from firmware_py.core.state_codec import VERSION
from firmware_py.estimate import heading_estimator, water
from firmware_py.faults.table import TABLE
from firmware_py.guidance.guidance import GuidanceState, apply_changes
from firmware_py.guidance.line import LineState
from firmware_py.guidance.mission_progress import MissionProgress, is_halted
from firmware_py.guidance.orbit import OrbitState
from firmware_py.guidance.task_follower import TaskFollowerState
from firmware_py.guidance.tasks import Task
from firmware_py.modes import ModeState

# Values are rounded down to these steps, so that small changes do not cause a write.
ELAPSED_STEP_S, TURNED_STEP_RAD, CURRENT_STEP_M_S = 30.0, 0.2, 0.1
MAX_AGE_S = 3.2e8  # ten years; a larger age by the calendar clock is a wrong clock
OFF, ALL = 0, 2  # values of BOOT_RESUME; 1: all but arming


class Moment(msgspec.Struct, frozen=True):
    """A time by the calendar clock, which may be wrong, and by the monotonic clock (`machine_s`) of a boot.

    `boot` is the boot id of the computer; empty: unknown.
    """

    utc_s: float
    boot: str = ""
    machine_s: float = 0.0

    def at(self, t_s: float, utc_s: float) -> Moment:
        """Return the moment t_s later, with utc_s by the calendar clock."""
        return Moment(utc_s, self.boot, self.machine_s + t_s)


class Resume(msgspec.Struct, frozen=True):
    """Stored record; `utc_s`, `boot` and `machine_s` are the `Moment` of its writing."""

    utc_s: float
    modes: ModeState
    mission: MissionProgress
    task: Task | None = None
    arrived: bool = False
    line: LineState | None = None
    orbit: OrbitState = OrbitState()
    fence_enabled: bool | None = None
    home: Home | None = None
    water: tuple[float, float, float] | None = None  # current north and east, speed [m/s]; None: expected values
    place: LastPosition | None = None
    boot: str = ""
    machine_s: float = 0.0


def resume_of(state: State, now: Moment) -> Resume:
    """Return the record of a state."""
    # A command is stored before the next tick applies it, so the guidance of that tick is stored.
    guidance_state = apply_changes(state.guidance, state.modes, state.plans)
    return Resume(
        now.utc_s,
        replace(_modes_to_store(state), stick=None, stick_t_s=0.0, bench=None, bench_until_s=0.0),
        replace(
            guidance_state.mission,
            elapsed_s=_round_down(guidance_state.mission.elapsed_s, ELAPSED_STEP_S),
            idle_items=0,
        ),
        guidance_state.task,
        guidance_state.follower.arrived,
        _line_at_start(guidance_state.follower.line),
        OrbitState(None, _round_down(guidance_state.follower.orbit.turned_rad, TURNED_STEP_RAD)),
        guidance_state.fence_enabled,
        state.home,
        _expected_water(state),
        last_position.make_last_position(state.position, state.heading_estimator.water),
        now.boot,
        now.machine_s,
    )


def _modes_to_store(state: State) -> ModeState:
    """Return the mode state; during a failsafe that always resumes, with mode and goal before it."""
    supervisor = state.supervisor
    fault = supervisor.failsafe.fault
    interrupted = supervisor.mode_after_failsafe(resume=bool(state.parameters["FS_RESUME"]))
    if fault is None or interrupted is None or not TABLE[fault].always_resumes:
        return state.modes
    return replace(state.modes, mode=interrupted.mode, goal=interrupted.goal, by_failsafe=interrupted.by_failsafe)


def _expected_water(state: State) -> tuple[float, float, float]:
    north_m_s, east_m_s, speed_m_s, _ = water.guidance_values(state.heading_estimator.water)
    step = CURRENT_STEP_M_S
    return _round_down(north_m_s, step), _round_down(east_m_s, step), _round_down(speed_m_s, step)


def _round_down(value: float, step: float) -> float:
    return math.floor(value / step) * step


def to_bytes(resume: Resume) -> bytes:
    """Return the encoded record."""
    return record_codec.encode(resume, VERSION)


def from_bytes(data: bytes) -> tuple[Resume, tuple[str, ...]]:
    """Return a stored record and notes on ignored parts; ValueError if it is incomplete or has invalid numbers."""
    resume, notes = record_codec.decode(Resume, data, VERSION)
    line = resume.line  # of which only start and tries are used
    if not _is_finite(replace(resume, line=None)) or (line is not None and not _is_finite(line.start)):
        raise ValueError("it holds a number that is not finite")
    return resume, notes


def _line_at_start(line: LineState | None) -> LineState | None:
    """Return the part of the line state that is stored: start and tries."""
    return None if line is None else LineState(line.start, tries=line.tries)


def _is_finite(value: Any) -> bool:
    """Return whether all numbers of a record are finite, at any depth."""
    if isinstance(value, msgspec.Struct):
        return all(_is_finite(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, tuple):
        return all(map(_is_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def _age_by_boot_s(resume: Resume, now: Moment) -> float | None:
    """Return the age of the record by the monotonic clock; None if the computer has rebooted since then."""
    is_same = now.boot and resume.boot == now.boot and resume.machine_s <= now.machine_s
    return now.machine_s - resume.machine_s if is_same else None


def _age_by_calendar_s(resume: Resume, now: Moment) -> float | None:
    """Return the age of the record by the calendar clock; None if it is impossible."""
    age_s = now.utc_s - resume.utc_s
    return age_s if 0.0 <= age_s < MAX_AGE_S else None


def restore(state: State, data: bytes, now: Moment) -> tuple[State, tuple[str, ...]]:
    """Return the start state with the stored record applied, and notes on ignored parts.

    `State.greeting` reports the result. Raise ValueError if the data are not a record.
    """
    level = int(state.parameters["BOOT_RESUME"])
    if level == OFF:
        return state, ()
    resume, notes = from_bytes(data)
    elapsed_s = _age_by_boot_s(resume, now)
    age_s = _age_by_calendar_s(resume, now) if elapsed_s is None else elapsed_s
    if age_s is not None and age_s > 3600.0 * state.parameters["BOOT_RESUME_H"]:
        return replace(state, greeting=f"Not resumed: {_format_age(age_s)} old"), notes
    if resume.place is not None:
        try:
            state = replace(state, position=last_position.restore(resume.place, elapsed_s))
        except ValueError as error:
            notes += (f"Resume.place ignored: {error}",)
            resume = replace(resume, place=None)
    is_armed = resume.modes.armed if level == ALL else state.modes.armed
    expected = resume.water if resume.place is None else last_position.water_of(resume.place)
    follower = TaskFollowerState(resume.task, resume.arrived, _line_at_start(resume.line), orbit=resume.orbit)
    guidance_state = GuidanceState(
        resume.modes.mode,
        resume.modes.armed and is_armed,
        resume.mission,
        resume.task,
        follower,
        fence_enabled=resume.fence_enabled,
    )
    paused_text = ", paused" if resume.modes.mode is Mode.AUTO and is_halted(resume.mission) else ""
    age_text = "age unknown" if age_s is None else f"{_format_age(age_s)} old"
    greeting = f"Resumed {resume.modes.mode.name}{paused_text}, {age_text}"
    state = replace(
        state,
        modes=replace(resume.modes, armed=is_armed),
        guidance=guidance_state,
        home=resume.home,
        heading_estimator=state.heading_estimator
        if expected is None
        else heading_estimator.with_expected_water(state.heading_estimator, expected),
        greeting=greeting + (", incomplete" if notes else ""),
    )
    return state, notes


def _format_age(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.0f} h"
