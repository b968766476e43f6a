"""Onboard logs in the form of a run, with the estimate of the autopilot instead of the truth, and its texts.

Columns are read by name, so logs of other versions can be read. Logs of several starts have the time of their dates; a
log without a date, or with a date before the end of the previous log, directly follows that log.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from firmware_py.common.angles import wrap_pi
from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.plan import Plan, PlanKind, first_item_number
from firmware_py.common.reports import Activity
from firmware_py.log.dataflash import LogError
from firmware_py.log.open_file import open_buffer
from hil.errors import UsageError
from hil.report.log_records import SAME_START_S, LogContents, LogFile, Segment
from hil.sim.truth import Array, Truth

_LINE: Final = Activity.LINE.value
_ANY_FAULTS: Final = float(1 << 63)  # limit of a mask of faults; larger values are damage
MIN_GOAL_S = 60.0  # a goal that lasts this long has figures
_DEFAULTS: Final = {row.name: row.default for row in TABLE}


@dataclass(frozen=True, slots=True)
class ModePeriod:
    """A period in one mode: start, duration, and in degrees the errors (heading minus goal) and the rudder travel."""

    t_s: float
    seconds: float
    mode: int
    armed: bool
    mean_error_deg: float
    rms_error_deg: float
    travel_deg_per_h: float


@dataclass(frozen=True, slots=True)
class FieldLog:
    """Content of logs; `texts`: time, severity, text.

    `truth` is the estimate of the autopilot, with the speed over ground. `lasting_goal_rad` is the goal where it lasted
    MIN_GOAL_S, else NaN. `columns` are further columns, named with their units as in firmware_py/view/model.py, NaN
    where a tick has no value. `plans` and `home` (degrees) are the latest; positions are relative to `origin`, mission
    items count from `first_item`. `late_us` are percentiles by name; `utc_s` is UTC at time 0 by the first log with a
    dated fix, `start_s` the process time then. `cuts` are the first rows of logs that do not continue the previous one.
    """

    truth: Truth
    lasting_goal_rad: Array
    mode_periods: tuple[ModePeriod, ...]
    texts: tuple[tuple[float, int, str], ...]
    settings: Mapping[str, float]
    software: str
    utc_s: float | None
    start_s: float
    ticks: int
    skipped: int
    late_us: Mapping[str, float]
    steering_wh: float
    notes: tuple[str, ...]
    segments: tuple[Segment, ...]
    cuts: tuple[int, ...]
    columns: Mapping[str, Array] = field(default_factory=dict)
    plans: Mapping[str, Plan] = field(default_factory=dict)
    home: tuple[float, float] | None = None
    origin: tuple[float, float] | None = None
    first_item: int = 0

    def axis_utc_s(self) -> float | None:
        """Return UTC at time 0 if it is the same in all logs, else None."""
        is_common = all(
            segment.utc_s is not None and abs(segment.utc_s - (self.utc_s or 0.0)) <= SAME_START_S
            for segment in self.segments
        )
        return self.utc_s if is_common else None


def read(paths: Sequence[Path], *, every: int = 1) -> FieldLog:
    """Read logs in their order, with a row for one of `every` ticks.

    Raises UsageError for a log that cannot be read and if no log contains a tick.
    """
    contents = LogContents(every=every)
    for path in paths:
        try:
            with open_buffer(path) as data:
                LogFile(path, contents).read(data)
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror or error}") from None
        except LogError as error:
            raise UsageError(f"{path}: {error}") from None
    if not contents.columns["time_s"]:
        raise UsageError(f"{paths[0] if paths else 'no log'}: not a Rambler log, or empty; give a log of the autopilot")
    return _assemble(contents)


def _assemble(contents: LogContents) -> FieldLog:
    columns = {name: np.asarray(column) for name, column in contents.columns.items()}
    time_s = columns["time_s"]
    start_rows = (int(np.searchsorted(time_s, segment.begin_s)) for segment in contents.segments if segment.is_apart)
    cuts = tuple(start_row for start_row in start_rows if 0 < start_row < time_s.size)
    heading = _fill_gaps(columns["heading"])
    hull = np.unwrap(np.where(np.isnan(columns["hull"]), heading, _fill_gaps(columns["hull"])))
    error = np.array([wrap_pi(value) if math.isfinite(value) else math.nan for value in columns["error"]])
    goal = hull + error  # within half a turn of the unwrapped heading
    rudder = np.where(np.isnan(columns["rudder"]), columns["command"], columns["rudder"])
    north_m, east_m, speed_m_s = _track(contents.fixes, time_s)
    truth = Truth(
        time_s, hull, _shifted_compass(hull, columns["compass"], heading), _fill_gaps(columns["yaw_rate"]),
        _fill_gaps(rudder), _fill_gaps(columns["command"]), goal, north_m, east_m, speed_m_s,
    )  # fmt: skip
    origin = (
        (math.degrees(contents.fixes["lat"][0]), math.degrees(contents.fixes["lng"][0]))
        if contents.fixes["t"]
        else None
    )
    late_us = np.asarray(contents.late_s) * 1e6
    late_us = late_us[np.isfinite(late_us)]
    percentiles = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}
    return FieldLog(
        truth=truth,
        lasting_goal_rad=_lasting_goals(time_s, columns["goal"], goal, cuts),
        mode_periods=tuple(_mode_periods(truth, columns["mode"], columns["armed"], error, cuts)),
        texts=tuple(contents.texts),
        settings={name: value for name, value in contents.settings.items() if _is_set(name, value)},
        software=contents.software,
        utc_s=contents.utc_s,
        start_s=contents.start_s,
        ticks=contents.ticks,
        skipped=contents.skipped,
        late_us={name: float(np.percentile(late_us, percent)) for name, percent in percentiles.items()}
        if late_us.size
        else {},
        steering_wh=contents.steering_j / 3600.0,
        notes=tuple(contents.notes),
        segments=tuple(contents.segments),
        cuts=cuts,
        columns=_extra_columns(columns),
        plans=contents.orders.plans,
        home=contents.orders.home or origin,
        origin=origin,
        first_item=first_item_number(
            int(contents.settings.get("LNK_IDENTITY", _DEFAULTS["LNK_IDENTITY"])), PlanKind.MISSION
        ),
    )


def _extra_columns(columns: Mapping[str, Array]) -> dict[str, Array]:
    faults = columns["faults"]
    counts = np.array([float(int(mask).bit_count()) if 0.0 <= mask < _ANY_FAULTS else math.nan for mask in faults])
    return {
        "ground_m_s": columns["ground"],
        "water_m_s": columns["water"],
        "current_m_s": np.hypot(columns["current_north"], columns["current_east"]),
        "goal_deg": np.degrees(columns["goal"]),
        "error_deg": -np.degrees(columns["error"]),
        "cross_track_m": np.where(columns["activity"] == _LINE, columns["cross_track"], math.nan),
        "fence_margin_m": columns["fence_margin"],
        "wave_period_s": columns["wave_period"],
        "wave_sd_deg": np.degrees(columns["wave_sd"]),
        "battery_v": columns["battery_v"],
        "charge_percent": columns["charge"] * 100.0,
        "servo_w": columns["servo_w"],
        "solar_w": columns["solar_w"],
        "load_w": columns["load_w"],
        "wind_m_s": columns["wind"],
        "gust_m_s": columns["gust"],
        "depth_m": columns["depth"],
        "item": columns["item"],
        "faults": counts,
    }


def _is_set(name: str, value: float) -> bool:
    return not math.isclose(value, _DEFAULTS.get(name, math.nan), rel_tol=1e-6, abs_tol=1e-9)


def _fill_gaps(values: Array) -> Array:
    """Return the values with gaps filled by the previous value, or by the first one; zeros if all are missing."""
    finite_rows = np.flatnonzero(np.isfinite(values))
    if not finite_rows.size:
        return np.zeros_like(values)
    latest = np.searchsorted(finite_rows, np.arange(values.size), side="right") - 1
    return np.asarray(np.where(latest < 0, values[finite_rows[0]], values[finite_rows[np.maximum(latest, 0)]]))


def _shifted_compass(hull_rad: Array, compass_rad: Array, heading_rad: Array) -> Array:
    """Return the compass heading without its mean difference from the heading of the hull."""
    compass_rad = _fill_gaps(np.where(np.isfinite(compass_rad), compass_rad, heading_rad))
    difference_rad = _wrap(compass_rad - hull_rad)
    mean_rad = math.atan2(float(np.mean(np.sin(difference_rad))), float(np.mean(np.cos(difference_rad))))
    return hull_rad + _wrap(difference_rad - mean_rad)


def _wrap(angle_rad: Array) -> Array:
    return np.asarray(np.remainder(angle_rad + math.pi, math.tau) - math.pi)


def _track(fixes: Mapping[str, array[float]], time_s: Array) -> tuple[Array, Array, Array]:
    """Return the positions north and east of the first fix and the speed over ground at the ticks; 0 without fixes."""
    t, lat, lng, speed = (np.asarray(column) for column in fixes.values())
    if not t.size:
        return np.zeros_like(time_s), np.zeros_like(time_s), np.zeros_like(time_s)
    order = np.argsort(t, kind="stable")
    north = (lat - lat[0]) * EARTH_RADIUS_M
    east = _wrap(lng - lng[0]) * math.cos(float(lat[0])) * EARTH_RADIUS_M
    return (
        np.interp(time_s, t[order], north[order]),
        np.interp(time_s, t[order], east[order]),
        np.interp(time_s, t[order], _fill_gaps(speed)[order]),
    )


def _lasting_goals(time_s: Array, wrapped_goal_rad: Array, goal_rad: Array, cuts: Sequence[int]) -> Array:
    """Return the goal in each period in which it lasts MIN_GOAL_S, NaN elsewhere."""
    lasting_rad = np.full_like(goal_rad, np.nan)
    if not time_s.size:
        return lasting_rad
    is_changed = (wrapped_goal_rad[1:] != wrapped_goal_rad[:-1]) | (np.abs(np.diff(goal_rad)) > math.pi)
    changes = np.flatnonzero(is_changed) + 1
    for first, last in pairwise([0, *np.union1d(changes, cuts).astype(int), time_s.size]):
        if last - first > 1 and time_s[last - 1] - time_s[first] >= MIN_GOAL_S and np.isfinite(goal_rad[first]):
            turns = round((goal_rad[first] - wrapped_goal_rad[first]) / math.tau)  # the heading is unwrapped
            lasting_rad[first:last] = wrapped_goal_rad[first] + turns * math.tau
    lasting_rad[list(cuts)] = np.nan  # a goal that continues in the next log counts as another one there
    return lasting_rad


def _mode_periods(
    truth: Truth, mode: Array, armed: Array, error_rad: Array, cuts: Sequence[int]
) -> Iterator[ModePeriod]:
    state = np.nan_to_num(mode) * 2.0 + np.nan_to_num(armed)
    changes = np.flatnonzero(np.diff(state)) + 1
    for first, last in pairwise([0, *np.union1d(changes, cuts).astype(int), state.size]):
        rows = slice(first, last)
        seconds = float(truth.time_s[rows][-1] - truth.time_s[rows][0])
        errors = np.degrees(error_rad[rows][np.isfinite(error_rad[rows])])
        travel_deg = float(np.degrees(np.sum(np.abs(np.diff(truth.rudder_rad[rows])))))
        yield ModePeriod(
            float(truth.time_s[rows][0]),
            seconds,
            int(state[rows][0]) // 2,
            bool(int(state[rows][0]) % 2),
            -float(errors.mean()) if errors.size else math.nan,
            float(np.sqrt(np.mean(errors**2))) if errors.size else math.nan,
            travel_deg * 3600.0 / seconds if seconds > 0.0 else 0.0,
        )
