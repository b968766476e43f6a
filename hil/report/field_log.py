"""Onboard logs in the form of a run: the boat's own estimate in place of the truth, and its texts.

Columns are read by name, so that a log of another version shows what it contains. Logs of several starts are placed at
their dates; one without a date, or with a date before the end of the previous log, directly behind that log.
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
from hil.report.log_records import SAME_START_S, Gathered, LogFile, Segment
from hil.sim.truth import Array, Truth

_LINE: Final = Activity.LINE.value
_ANY_FAULTS: Final = float(1 << 63)
HOLD_S = 60.0  # a goal that lasts this long has figures
_DEFAULTS: Final = {row.name: row.default for row in TABLE}


@dataclass(frozen=True, slots=True)
class Stretch:
    """A period in one mode: start, duration, and in degrees the heading errors and the rudder travel."""

    t_s: float
    seconds: float
    mode: int
    armed: bool
    mean_error_deg: float
    rms_error_deg: float
    travel_deg_per_h: float


@dataclass(frozen=True, slots=True)
class FieldLog:
    """Content of logs; `goal_held_rad` is the goal where it lasted HOLD_S, else NaN; `texts`: time, severity, text.

    `more` holds columns in addition to the truth, by the names and in the units of the page's model, NaN where a tick
    has no value. `plans` and `home` (degrees) are the latest; north and east count from `origin`, mission items from
    `first_item`. `late_us` are percentiles by name; `utc_s` is UTC at time 0 by the first log with a dated fix,
    `start_s` the time of the process then. `cuts` are the first rows of logs that do not continue the previous one.
    """

    truth: Truth
    goal_held_rad: Array
    stretches: tuple[Stretch, ...]
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
    more: Mapping[str, Array] = field(default_factory=dict)
    plans: Mapping[str, Plan] = field(default_factory=dict)
    home: tuple[float, float] | None = None
    origin: tuple[float, float] | None = None
    first_item: int = 0

    def axis_utc_s(self) -> float | None:
        """Return UTC at time 0 if it is the same in all logs, else None."""
        agree = all(
            one.utc_s is not None and abs(one.utc_s - (self.utc_s or 0.0)) <= SAME_START_S for one in self.segments
        )
        return self.utc_s if agree else None


def read(paths: Sequence[Path], *, every: int = 1) -> FieldLog:
    """Read logs in their order, with a row for one of `every` ticks.

    Raises UsageError for a log that cannot be read, and if no log holds a tick.
    """
    got = Gathered(every=every)
    for path in paths:
        try:
            with open_buffer(path) as data:
                LogFile(path, got).read(data)
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror or error}") from None
        except LogError as error:
            raise UsageError(f"{path}: {error}") from None
    if not got.columns["time_s"]:
        raise UsageError(f"{paths[0] if paths else 'no log'}: not a Rambler log, or empty; give a log of the autopilot")
    return _made(got)


def _made(got: Gathered) -> FieldLog:
    columns = {name: np.asarray(column) for name, column in got.columns.items()}
    time_s = columns["time_s"]
    places = (int(np.searchsorted(time_s, one.begin_s)) for one in got.segments if one.is_apart)
    cuts = tuple(place for place in places if 0 < place < time_s.size)
    heading = _filled(columns["heading"])
    hull = np.unwrap(np.where(np.isnan(columns["hull"]), heading, _filled(columns["hull"])))
    error = np.array([wrap_pi(value) if math.isfinite(value) else math.nan for value in columns["error"]])
    goal = hull + error  # on the heading's turn
    rudder = np.where(np.isnan(columns["rudder"]), columns["command"], columns["rudder"])
    north_m, east_m, speed_m_s = _track(got.fixes, time_s)
    truth = Truth(
        time_s, hull, _beside(hull, columns["compass"], heading), _filled(columns["yaw_rate"]), _filled(rudder),
        _filled(columns["command"]), goal, north_m, east_m, speed_m_s,
    )  # fmt: skip
    first = (math.degrees(got.fixes["lat"][0]), math.degrees(got.fixes["lng"][0])) if got.fixes["t"] else None
    late_us = np.asarray(got.late_s) * 1e6
    late_us = late_us[np.isfinite(late_us)]
    percentiles = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}
    return FieldLog(
        truth=truth,
        goal_held_rad=_held(time_s, columns["goal"], goal, cuts),
        stretches=tuple(_stretches(truth, columns["mode"], columns["armed"], error, cuts)),
        texts=tuple(got.texts),
        settings={name: value for name, value in got.settings.items() if _is_set(name, value)},
        software=got.software,
        utc_s=got.utc_s,
        start_s=got.start_s,
        ticks=got.ticks,
        skipped=got.skipped,
        late_us={name: float(np.percentile(late_us, part)) for name, part in percentiles.items()}
        if late_us.size
        else {},
        steering_wh=got.steering_j / 3600.0,
        notes=tuple(got.notes),
        segments=tuple(got.segments),
        cuts=cuts,
        more=_more(columns),
        plans=got.orders.plans,
        home=got.orders.home or first,
        origin=first,
        first_item=first_item_number(
            int(got.settings.get("LNK_IDENTITY", _DEFAULTS["LNK_IDENTITY"])), PlanKind.MISSION
        ),
    )


def _more(columns: Mapping[str, Array]) -> dict[str, Array]:
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
        "item": columns["item"],
        "faults": counts,
    }


def _is_set(name: str, value: float) -> bool:
    return not math.isclose(value, _DEFAULTS.get(name, math.nan), rel_tol=1e-6, abs_tol=1e-9)


def _filled(values: Array) -> Array:
    """Return the values with gaps filled by the previous value, 0 before the first."""
    known = np.flatnonzero(np.isfinite(values))
    if not known.size:
        return np.zeros_like(values)
    place = np.searchsorted(known, np.arange(values.size), side="right") - 1
    return np.asarray(np.where(place < 0, values[known[0]], values[known[np.maximum(place, 0)]]))


def _beside(hull_rad: Array, compass_rad: Array, heading_rad: Array) -> Array:
    """Return the compass heading near the hull's heading, with the mean difference removed."""
    compass_rad = _filled(np.where(np.isfinite(compass_rad), compass_rad, heading_rad))
    off_rad = _wrapped(compass_rad - hull_rad)
    mean_rad = math.atan2(float(np.mean(np.sin(off_rad))), float(np.mean(np.cos(off_rad))))
    return hull_rad + _wrapped(off_rad - mean_rad)


def _wrapped(angle_rad: Array) -> Array:
    return np.asarray(np.remainder(angle_rad + math.pi, math.tau) - math.pi)


def _track(fixes: Mapping[str, array[float]], time_s: Array) -> tuple[Array, Array, Array]:
    """Return north and east of the first fix and the speed over the ground at the ticks; zeros without fixes."""
    t, lat, lng, speed = (np.asarray(column) for column in fixes.values())
    if not t.size:
        return np.zeros_like(time_s), np.zeros_like(time_s), np.zeros_like(time_s)
    order = np.argsort(t, kind="stable")
    north = (lat - lat[0]) * EARTH_RADIUS_M
    east = _wrapped(lng - lng[0]) * math.cos(float(lat[0])) * EARTH_RADIUS_M
    return (
        np.interp(time_s, t[order], north[order]),
        np.interp(time_s, t[order], east[order]),
        np.interp(time_s, t[order], _filled(speed)[order]),
    )


def _held(time_s: Array, named_rad: Array, goal_rad: Array, cuts: Sequence[int]) -> Array:
    """Return the goal for each period in which it lasted HOLD_S, NaN elsewhere."""
    held = np.full_like(goal_rad, np.nan)
    if not time_s.size:
        return held
    changes = np.flatnonzero((named_rad[1:] != named_rad[:-1]) | (np.abs(np.diff(goal_rad)) > math.pi)) + 1
    for first, last in pairwise([0, *np.union1d(changes, cuts).astype(int), time_s.size]):
        if last - first > 1 and time_s[last - 1] - time_s[first] >= HOLD_S and np.isfinite(goal_rad[first]):
            turns = round((goal_rad[first] - named_rad[first]) / math.tau)  # the heading is unwrapped
            held[first:last] = named_rad[first] + turns * math.tau
    held[list(cuts)] = np.nan  # a goal that continues in the next log counts there as another one
    return held


def _stretches(truth: Truth, mode: Array, armed: Array, error_rad: Array, cuts: Sequence[int]) -> Iterator[Stretch]:
    state = np.nan_to_num(mode) * 2.0 + np.nan_to_num(armed)
    changes = np.flatnonzero(np.diff(state)) + 1
    for first, last in pairwise([0, *np.union1d(changes, cuts).astype(int), state.size]):
        part = slice(first, last)
        seconds = float(truth.time_s[part][-1] - truth.time_s[part][0])
        errors = np.degrees(error_rad[part][np.isfinite(error_rad[part])])
        travel_deg = float(np.degrees(np.sum(np.abs(np.diff(truth.rudder_rad[part])))))
        yield Stretch(
            float(truth.time_s[part][0]),
            seconds,
            int(state[part][0]) // 2,
            bool(int(state[part][0]) % 2),
            -float(errors.mean()) if errors.size else math.nan,
            float(np.sqrt(np.mean(errors**2))) if errors.size else math.nan,
            travel_deg * 3600.0 / seconds if seconds > 0.0 else 0.0,
        )
