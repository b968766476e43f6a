"""Read logs of the autopilot, with the inputs of its ticks, and logs of ArduPilot as recordings."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np
from msgspec.structs import replace

from firmware_py.common.angles import radians
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.records import FixType, HeadingSample, NorthReference, PositionSample, RudderFeedback
from firmware_py.log.dataflash import Buffer, LogError
from firmware_py.log.open_file import open_buffer
from firmware_py.log.reader import LogReader
from hil.errors import UsageError
from hil.lab.estimate.recording import Recording
from hil.lab.identify import ardupilot_log
from hil.lab.identify.onboard_log import keep_increasing
from hil.lab.identify.recording import MIN_ROWS
from hil.report.log_records import records

MIN_3D_STATUS = 3  # ArduPilot's GPS.Status of a 3D fix
MAX_TIME_S = 1e9  # larger times are treated as damaged

Sample = TypeVar("Sample", HeadingSample, PositionSample, RudderFeedback)


def is_log(path: Path) -> bool:
    """Return whether a file name is that of a log."""
    return path.name.lower().removesuffix(".gz").endswith(".bin")


def read(path: Path) -> Recording:
    """Read a log of the autopilot or of ArduPilot, or raise UsageError."""
    try:
        with open_buffer(path) as data:
            return _read_ardupilot(path, data) if ardupilot_log.is_ardupilot_log(data) else _read_autopilot(path, data)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}; give the path of a .BIN or .BIN.gz file") from None
    except LogError as error:
        raise UsageError(f"{path}: {error}") from None


def _read_autopilot(path: Path, data: Buffer) -> Recording:
    """Return the inputs of the ticks as a recording; without feedback the commands replace the rudder angle."""
    reader = LogReader(path)
    notes: list[str] = []
    headings: list[HeadingSample] = []
    positions: list[PositionSample] = []
    rudder: list[RudderFeedback] = []
    commands: list[RudderFeedback] = []
    sensor: list[RudderFeedback] = []
    parameters: Mapping[str, float] | None = None
    for tick in reader:
        headings.extend(sample for sample in tick.inputs.headings if sample.reference is not NorthReference.RELATIVE)
        positions.extend(tick.inputs.positions)
        rudder.extend(tick.inputs.rudder)
        sensor.extend(RudderFeedback(sample.t_s, sample.rudder_rad) for sample in tick.inputs.rudder_angles)
        commands.append(RudderFeedback(tick.inputs.tick.t_s, tick.command.shaft_rad))
        if parameters is None and tick.checkpoint is not None:
            parameters = _parameters(tick.checkpoint)
    if reader.reading.damaged:
        notes.append(f"{reader.reading.damaged} damaged ticks ignored")
    if parameters is None:
        notes.append("no stored parameters: defaults are used, and the servo shaft as rudder angle")
    if sensor:
        rudder = sensor
        notes.append("angles of the rudder angle sensor used")
    elif not any(sample.shaft_rad is not None for sample in rudder):
        rudder = commands
        notes.append("no rudder feedback: the command is used as rudder angle")
    headings = [sample for sample in _keep_increasing(headings) if math.isfinite(sample.heading_rad)]
    if len(headings) < MIN_ROWS:
        raise UsageError(f"{path}: contains {len(headings)} headings; give a log of a run with a compass")
    source = Counter(sample.source for sample in headings).most_common(1)[0][0]
    begin_s = headings[0].t_s
    goals = [
        (t_s - begin_s, goal)
        for t_s, goal in _goals(data)
        if 0.0 <= t_s < MAX_TIME_S and not abs(goal) > 2.0 * math.tau
    ]
    speeds = [sample.speed_over_ground_m_s for sample in positions if sample.speed_over_ground_m_s is not None]
    return Recording(
        str(path),
        begin_s,
        np.array([sample.t_s for sample in headings if sample.source == source]),
        tuple(_shift_times(headings, begin_s)),
        tuple(_shift_times(_keep_increasing(positions), begin_s)),
        tuple(_shift_times(_keep_increasing(rudder), begin_s)),
        np.array([t_s for t_s, _ in goals]),
        np.array([goal for _, goal in goals]),
        source=source,
        is_shaft=not sensor,
        ground_m_s=float(np.mean(speeds)) if speeds else None,
        parameters=parameters or {},
        notes=tuple(notes),
    )


def _goals(data: Buffer) -> list[tuple[float, float]]:
    """Return the times of ticks with their heading goals."""
    goals, now_s = [], math.nan
    for name, values in records(data, {"TICK": ("T",), "NAV": ("Goal",)}):
        value = float(values[0]) if isinstance(values[0], (int, float)) else math.nan
        if name == "TICK":
            now_s = value
        else:
            goals.append((now_s, value))
    return goals


def _parameters(checkpoint: str) -> dict[str, float]:
    """Return the parameters of a stored state that are known and valid."""
    try:
        stored = json.loads(checkpoint)["parameters"].items()
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}
    values = {}
    for name, value in stored:
        if name in INDEX and isinstance(value, (int, float)):
            try:
                values[name] = TABLE[INDEX[name]].check(float(value))
            except (ParameterError, OverflowError):
                continue
    return values


def _keep_increasing(samples: list[Sample]) -> list[Sample]:
    """Remove samples with invalid times and with decreasing times, as after a restart."""
    kept_samples: list[Sample] = []
    for sample in samples:
        if math.isfinite(sample.t_s) and (not kept_samples or sample.t_s >= kept_samples[-1].t_s):
            kept_samples.append(sample)
    return kept_samples


def _shift_times(samples: list[Sample], begin_s: float) -> list[Sample]:
    return [replace(sample, t_s=sample.t_s - begin_s) for sample in samples]


def _read_ardupilot(path: Path, data: Buffer) -> Recording:
    """Return attitude, fixes and rudder as a recording; ArduPilot's yaw is relative to true north."""
    series, servos = ardupilot_log.collect_series(data)
    headings = ardupilot_log.read_headings(path, series)
    notes: list[str] = []
    begin_s = headings[0][0]
    rudder = ardupilot_log.rudder_angles(series, servos, notes)
    goals = series["ATT.DesYaw"] if len({goal for _, goal in series["ATT.DesYaw"]}) > 1 else []
    labels = ("Lat", "Lng", "Spd", "GCrs")
    table = {name: dict(series[f"GPS.{name}"]) for name in (*labels, "Status")}
    fixes = []
    for t_s, _ in keep_increasing(series["GPS.Lat"]):
        latitude, longitude, speed_m_s, course_deg = (table[name].get(t_s) for name in labels)
        if latitude is None or longitude is None or table["Status"].get(t_s, MIN_3D_STATUS) < MIN_3D_STATUS:
            continue
        fixes.append(
            PositionSample(
                t_s - begin_s,
                FixType.FIX_3D,
                radians(latitude),
                radians(longitude),
                speed_over_ground_m_s=speed_m_s,
                course_over_ground_rad=None if course_deg is None else radians(course_deg) % math.tau,
            )
        )
    speeds = [sample.speed_over_ground_m_s for sample in fixes if sample.speed_over_ground_m_s is not None]
    return Recording(
        str(path),
        begin_s,
        np.array([t_s for t_s, _ in headings]),
        tuple(HeadingSample(t_s - begin_s, radians(yaw) % math.tau, NorthReference.TRUE) for t_s, yaw in headings),
        tuple(fixes),
        tuple(RudderFeedback(t_s - begin_s, angle) for t_s, angle in rudder),
        np.array([t_s - begin_s for t_s, _ in goals]),
        np.array([radians(goal) for _, goal in goals]),
        ground_m_s=float(np.mean(speeds)) if speeds else None,
        notes=tuple(notes),
    )
