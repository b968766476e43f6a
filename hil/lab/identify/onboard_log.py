"""Read an onboard log as a recording: headings, rudder feedback, speed of the fixes."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.common.records import HeadingSample, NorthReference
from firmware_py.log.dataflash import LogError
from firmware_py.log.reader import LoggedTick, LogReader
from hil.errors import UsageError
from hil.lab.identify.recording import MIN_ROWS, Floats, Recording

SMOOTHING_S = 60.0  # removes wave motion from the speed of the fixes
MIN_PRESENT_FRACTION = 0.95

Pair = tuple[float, float]


@dataclass(slots=True)
class _LogData:
    headings: list[HeadingSample] = field(default_factory=list)
    shaft_angles: list[Pair] = field(default_factory=list)
    sensor_angles: list[Pair] = field(default_factory=list)
    commands: list[Pair] = field(default_factory=list)
    speeds: list[Pair] = field(default_factory=list)
    centre_rad: float = 0.0
    sign: float = 1.0
    has_linkage: bool = False
    start_s: float | None = None


def read(path: Path) -> Recording:
    """Read a .BIN or .BIN.gz log, with times relative to its first tick, or raise UsageError."""
    reader = LogReader(path)
    try:
        log_data = _gather(reader)
    except LogError as error:
        raise UsageError(f"{path}: {error}") from None
    if log_data.start_s is None:
        raise UsageError(f"{path}: no complete tick; give a log of the autopilot")
    notes = []
    if reader.reading.damaged:
        notes.append(f"{reader.reading.damaged} damaged ticks ignored")
    headings = _one_kind(log_data.headings, notes)
    if len(headings) < MIN_ROWS:
        raise UsageError(f"{path}: {len(headings)} headings; give a log of a run with a compass")
    rudder, time_of_rudder = _rudder(path, log_data, notes)
    time_s = np.array([sample.t_s for sample in headings])
    yaw_rates = [sample.yaw_rate_rad_s for sample in headings]
    is_known = np.array([rate is not None for rate in yaw_rates])
    rates: Floats | None = None
    if is_known.mean() >= MIN_PRESENT_FRACTION:
        values = np.array([np.nan if rate is None else rate for rate in yaw_rates], dtype=np.float64)
        rates = np.interp(time_s, time_s[is_known], values[is_known])
    is_inside = (time_s >= time_of_rudder[0]) & (time_s <= time_of_rudder[-1])
    recording = Recording(
        str(path),
        time_s[is_inside] - log_data.start_s,
        np.interp(time_s, time_of_rudder, rudder)[is_inside],
        np.array([sample.heading_rad for sample in headings])[is_inside],
        None if rates is None else rates[is_inside],
        smooth_speed(log_data.speeds, time_s[is_inside], notes),
        tuple(notes),
    )
    columns = (recording.time_s, recording.rudder_rad, recording.heading_rad, rates, recording.speed_m_s)
    if not all(column is None or np.isfinite(column).all() for column in columns):
        raise UsageError(f"{path}: contains a number that is not finite; give a log of the autopilot")
    return recording


def _gather(ticks: Iterable[LoggedTick]) -> _LogData:
    log_data = _LogData()
    for tick in ticks:
        inputs = tick.inputs
        if log_data.start_s is None:
            log_data.start_s = inputs.tick.t_s
        if tick.checkpoint is not None:
            _read_linkage(log_data, tick.checkpoint)
        log_data.headings.extend(inputs.headings)
        log_data.shaft_angles.extend(
            (rudder.t_s, rudder.shaft_rad) for rudder in inputs.rudder if rudder.shaft_rad is not None
        )
        log_data.sensor_angles.extend((sample.t_s, sample.rudder_rad) for sample in inputs.rudder_angles)
        log_data.commands.append((inputs.tick.t_s, tick.command.shaft_rad))
        log_data.speeds.extend(
            (fix.t_s, fix.speed_over_ground_m_s) for fix in inputs.positions if fix.speed_over_ground_m_s is not None
        )
    return log_data


def _read_linkage(log_data: _LogData, checkpoint: str) -> None:
    """Read the relation of shaft and rudder from the parameters of a stored state."""
    try:
        parameters = json.loads(checkpoint)["parameters"]
        centre_deg, reverse = float(parameters["RUD_CENTRE_DEG"]), bool(parameters["RUD_REVERSE"])
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return
    log_data.centre_rad, log_data.sign, log_data.has_linkage = radians(centre_deg), -1.0 if reverse else 1.0, True


def _one_kind(samples: list[HeadingSample], notes: list[str]) -> list[HeadingSample]:
    """Return the headings of the most frequent compass and north reference, without gyroscopes; times increase."""
    samples = [sample for sample in samples if sample.reference is not NorthReference.RELATIVE]
    if not samples:
        return []
    kinds: Counter[tuple[int, NorthReference]] = Counter((sample.source, sample.reference) for sample in samples)
    (source, reference), count = kinds.most_common(1)[0]
    if count < len(samples):
        notes.append(
            f"{reference.name.lower()} headings of compass {source} used, {len(samples) - count} others ignored"
        )
    result: list[HeadingSample] = []
    for sample in samples:
        if (sample.source, sample.reference) == (source, reference) and (not result or sample.t_s > result[-1].t_s):
            result.append(sample)
    return result


def _rudder(path: Path, log_data: _LogData, notes: list[str]) -> tuple[Floats, Floats]:
    """Return rudder angles [rad] and their times [s]."""
    sensor = np.array(keep_increasing(log_data.sensor_angles), dtype=np.float64).reshape(-1, 2)
    if sensor.shape[0] >= MIN_ROWS:
        notes.append("angles of the rudder angle sensor used")
        return sensor[:, 1], sensor[:, 0]
    pairs = log_data.shaft_angles
    if len(pairs) < MIN_ROWS:
        pairs = log_data.commands
        notes.append("no rudder feedback: the command is used as rudder angle, so T includes the servo lag")
    if not log_data.has_linkage:
        notes.append("no stored parameters: the shaft angle is used as rudder angle")
    table = np.array(keep_increasing(pairs), dtype=np.float64)
    if table.shape[0] < MIN_ROWS:
        raise UsageError(f"{path}: too short, {table.shape[0]} rudder angles; give a longer log")
    return log_data.sign * (table[:, 1] - log_data.centre_rad), table[:, 0]


def smooth_speed(pairs: list[Pair], time_s: Floats, notes: list[str]) -> Floats | None:
    """Return a speed smoothed over SMOOTHING_S at the given times, None if the pairs do not cover them."""
    table = np.array(keep_increasing(pairs), dtype=np.float64).reshape(-1, 2)
    if table.shape[0] < MIN_ROWS or not time_s.size:
        return None
    if table[-1, 0] - table[0, 0] < MIN_PRESENT_FRACTION * (time_s[-1] - time_s[0]):
        return None
    total = np.concatenate(([0.0], np.cumsum(0.5 * (table[1:, 1] + table[:-1, 1]) * np.diff(table[:, 0]))))
    low = np.clip(time_s - SMOOTHING_S / 2, table[0, 0], table[-1, 0] - 1e-3)
    high = np.clip(time_s + SMOOTHING_S / 2, table[0, 0] + 1e-3, table[-1, 0])
    mean = (np.interp(high, table[:, 0], total) - np.interp(low, table[:, 0], total)) / (high - low)
    notes.append(f"speed over ground used, smoothed over {SMOOTHING_S:g} s")
    return np.asarray(mean, dtype=np.float64)


def keep_increasing(pairs: list[Pair]) -> list[Pair]:
    """Remove pairs whose time does not increase."""
    result: list[Pair] = []
    for pair in pairs:
        if not result or pair[0] > result[-1][0]:
            result.append(pair)
    return result
