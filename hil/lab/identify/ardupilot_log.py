"""Read a log of ArduPilot Rover: ATT for the heading, RCOU or STER for the rudder, GPS.

Sources: ArduPilot, libraries/AP_Logger/LogStructure.h and Rover/Log.cpp. The steering output is relative to full
rudder; ArduPilot writes it as if full rudder were 45 deg, and this module reads it with the same scale.
"""

from __future__ import annotations

import re
from collections import defaultdict
from math import isfinite
from pathlib import Path

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.log.dataflash import Buffer, Parser, decode_text
from hil.errors import UsageError
from hil.lab.identify.onboard_log import MIN_PRESENT_FRACTION, Pair, keep_increasing, smooth_speed
from hil.lab.identify.recording import MIN_ROWS, Floats, Recording

INTEGER_SCALES = {**dict.fromkeys("cCeE", 0.01), "L": 1e-7}  # scale of integer formats
SEARCH_BYTES = 1 << 17
GROUND_STEERING = 26  # value of SERVOn_FUNCTION
FULL_RUDDER_RAD = radians(45.0)
DEFAULT_PULSES_US = {"TRIM": 1500.0, "MIN": 1100.0, "MAX": 1900.0}  # microseconds
CENTIDEGREES_RAD = radians(0.01)
USED_FIELDS = {
    "ATT": ("Yaw", "DesYaw"),
    "STER": ("SteerOut", "TurnRate"),
    "STEE": ("SteerOut", "TurnRate"),
    "RATE": ("Y",),
    "GPS": ("Status", "Lat", "Lng", "Spd", "GCrs"),
}
_ATTITUDE_FORMAT = re.compile(rb"\xa3\x95\x80..ATT\0", re.DOTALL)  # FMT message of ATT
_TICK_FORMAT = re.compile(rb"\xa3\x95\x80..TICK", re.DOTALL)  # FMT message of Rambler's own logs
_CHANNEL = re.compile(r"C\d+")
_SERVO = re.compile(r"SERVO(\d+)_(FUNCTION|TRIM|MIN|MAX|REVERSED)")

Series = dict[str, list[Pair]]  # "ATT.Yaw" -> times [s] and values


def is_ardupilot_log(data: Buffer) -> bool:
    """Return whether the bytes are an ArduPilot log: with attitudes, without the ticks of Rambler's logs."""
    is_rambler_log = _TICK_FORMAT.search(data, 0, SEARCH_BYTES) is not None
    return not is_rambler_log and _ATTITUDE_FORMAT.search(data, 0, SEARCH_BYTES) is not None


def read(path: Path, data: Buffer) -> Recording:
    """Read a log, with times relative to its first heading, or raise UsageError."""
    series, servos = collect_series(data)
    headings = read_headings(path, series)
    notes: list[str] = []
    pairs = rudder_angles(series, servos, notes)
    if not pairs:
        raise UsageError(f"{path}: no rudder: neither RCOU of a servo with SERVOn_FUNCTION 26, nor STER")
    rudder = np.array(pairs, dtype=np.float64)
    table = np.array(headings, dtype=np.float64)
    table = table[(table[:, 0] >= rudder[0, 0]) & (table[:, 0] <= rudder[-1, 0])]
    if table.shape[0] < MIN_ROWS:
        raise UsageError(f"{path}: headings and rudder have {table.shape[0]} rows in common; give a longer log")
    time_s = table[:, 0]
    return Recording(
        str(path),
        time_s - time_s[0],
        np.interp(time_s, rudder[:, 0], rudder[:, 1]),
        table[:, 1] * radians(1.0),
        _yaw_rates(series, time_s),
        smooth_speed(series["GPS.Spd"], time_s, notes),
        tuple(notes),
    )


def read_headings(path: Path, series: Series) -> list[Pair]:
    """Return times and headings [deg], or raise UsageError for too few."""
    headings = keep_increasing(series["ATT.Yaw"])
    if len(headings) < MIN_ROWS:
        raise UsageError(f"{path}: {len(headings)} headings (ATT); give a log of a run")
    return headings


def collect_series(data: Buffer) -> tuple[Series, dict[int, dict[str, float]]]:
    """Return the used fields of all messages as series, and the SERVOn parameters of each servo n."""
    series: Series = defaultdict(list)
    servos: dict[int, dict[str, float]] = defaultdict(dict)
    for message_type, offset in Parser(data):
        if message_type.name not in USED_FIELDS and message_type.name not in ("RCOU", "PARM"):
            continue
        row = dict(zip(message_type.labels, message_type.unpack(data, offset), strict=False))
        numbers = {label: value for label, value in row.items() if isinstance(value, int | float) and isfinite(value)}
        name = row.get("Name")
        if message_type.name == "PARM" and isinstance(name, bytes) and "Value" in numbers:
            match = _SERVO.fullmatch(decode_text(name))
            if match is not None:
                servos[int(match[1])][match[2]] = float(numbers["Value"])
        if message_type.name == "PARM" or "TimeUS" not in numbers or numbers.get("I", 0) != 0:
            continue
        labels = USED_FIELDS.get(message_type.name) or tuple(filter(_CHANNEL.fullmatch, message_type.labels))
        for label in labels:
            if label in numbers:
                scale = INTEGER_SCALES.get(message_type.values[message_type.labels.index(label)], 1.0)
                series[f"{message_type.name}.{label}"].append((numbers["TimeUS"] * 1e-6, numbers[label] * scale))
    return series, servos


def rudder_angles(series: Series, servos: dict[int, dict[str, float]], notes: list[str]) -> list[Pair]:
    """Return times [s] and angles [rad]: of the rudder servo, or else of the steering command; empty without both."""
    notes.append("full rudder is assumed to be 45 deg, as in ArduPilot: K is wrong by the ratio to the real angle")
    for number, servo in sorted(servos.items()):
        pairs = keep_increasing(series[f"RCOU.C{number}"])
        if servo.get("FUNCTION") == GROUND_STEERING and len(pairs) >= MIN_ROWS:
            middle, low, high = (servo.get(name, default) for name, default in DEFAULT_PULSES_US.items())
            full_angle_rad = FULL_RUDDER_RAD * (-1.0 if servo.get("REVERSED", 0.0) else 1.0)
            half_range_us = {True: max(high - middle, 1.0), False: max(middle - low, 1.0)}
            notes.append(f"the output of SERVO{number} is used as rudder angle, so T includes the servo lag")
            return [
                (time_s, full_angle_rad * (pulse - middle) / half_range_us[pulse > middle])
                for time_s, pulse in pairs
                if pulse > 0
            ]
    for name in ("STER", "STEE"):
        pairs = keep_increasing(series[f"{name}.SteerOut"])
        if len(pairs) >= MIN_ROWS:
            notes.append(f"{name}.SteerOut is used as rudder angle, so T includes the servo lag")
            return [(time_s, CENTIDEGREES_RAD * value) for time_s, value in pairs]
    return []


def _yaw_rates(series: Series, time_s: Floats) -> Floats | None:
    """Return the yaw rate [rad/s] at the given times, None if no series covers almost all of them."""
    for name in ("RATE.Y", "STER.TurnRate", "STEE.TurnRate"):
        pairs = np.array(keep_increasing(series[name]), dtype=np.float64).reshape(-1, 2)
        if pairs.shape[0] >= MIN_PRESENT_FRACTION * time_s.size:
            return np.asarray(np.interp(time_s, pairs[:, 0], pairs[:, 1]) * radians(1.0))
    return None
