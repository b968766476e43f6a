"""Read a log of ArduPilot Rover: ATT for the heading, RCOU or STER for the rudder, GPS.

Sources: ArduPilot, libraries/AP_Logger/LogStructure.h and Rover/Log.cpp. The steering output is relative to full
rudder; ArduPilot writes it as if full rudder were 45 deg, and it is read so.
"""

from __future__ import annotations

import re
from collections import defaultdict
from math import isfinite
from pathlib import Path

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.log.dataflash import Buffer, Parser, text_of
from hil.errors import UsageError
from hil.lab.identify.onboard_log import PRESENT_SHARE, Pair, rising, smoothed_speed
from hil.lab.identify.recording import MIN_ROWS, Floats, Recording

SHARES = {**dict.fromkeys("cCeE", 0.01), "L": 1e-7}  # scale of integer formats
SEARCHED_BYTES = 1 << 17
GROUND_STEERING = 26  # of SERVOn_FUNCTION
FULL_RUDDER_RAD = radians(45.0)
USUAL_PULSES = {"TRIM": 1500.0, "MIN": 1100.0, "MAX": 1900.0}  # microseconds
CENTIDEGREES_RAD = radians(0.01)
USED = {
    "ATT": ("Yaw", "DesYaw"),
    "STER": ("SteerOut", "TurnRate"),
    "STEE": ("SteerOut", "TurnRate"),
    "RATE": ("Y",),
    "GPS": ("Status", "Lat", "Lng", "Spd", "GCrs"),
}
_ATTITUDE = re.compile(rb"\xa3\x95\x80..ATT\0", re.DOTALL)  # its FMT message
_TICK = re.compile(rb"\xa3\x95\x80..TICK", re.DOTALL)  # FMT message of Rambler's own logs
_CHANNEL = re.compile(r"C\d+")
_SERVO = re.compile(r"SERVO(\d+)_(FUNCTION|TRIM|MIN|MAX|REVERSED)")

Series = dict[str, list[Pair]]  # "ATT.Yaw" -> times [s] and values


def is_one(data: Buffer) -> bool:
    """Return whether the bytes are an ArduPilot log: with attitudes, without the ticks of Rambler's logs."""
    ours = _TICK.search(data, 0, SEARCHED_BYTES) is not None
    return not ours and _ATTITUDE.search(data, 0, SEARCHED_BYTES) is not None


def read(path: Path, data: Buffer) -> Recording:
    """Read a log, with times relative to its first heading, or raise UsageError."""
    series, servos = gathered(data)
    headings = headings_of(path, series)
    notes: list[str] = []
    pairs = rudder_of(series, servos, notes)
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
        _rate(series, time_s),
        smoothed_speed(series["GPS.Spd"], time_s, notes),
        tuple(notes),
    )


def headings_of(path: Path, series: Series) -> list[Pair]:
    """Return times and headings [deg], or raise UsageError for too few."""
    headings = rising(series["ATT.Yaw"])
    if len(headings) < MIN_ROWS:
        raise UsageError(f"{path}: {len(headings)} headings (ATT); give a log of a run")
    return headings


def gathered(data: Buffer) -> tuple[Series, dict[int, dict[str, float]]]:
    """Return the series, and the parameters of each servo."""
    series: Series = defaultdict(list)
    servos: dict[int, dict[str, float]] = defaultdict(dict)
    for kind, at in Parser(data):
        if kind.name not in USED and kind.name not in ("RCOU", "PARM"):
            continue
        row = dict(zip(kind.labels, kind.unpack(data, at), strict=False))
        numbers = {label: value for label, value in row.items() if isinstance(value, int | float) and isfinite(value)}
        name = row.get("Name")
        if kind.name == "PARM" and isinstance(name, bytes) and "Value" in numbers:
            found = _SERVO.fullmatch(text_of(name))
            if found is not None:
                servos[int(found[1])][found[2]] = float(numbers["Value"])
        if kind.name == "PARM" or "TimeUS" not in numbers or numbers.get("I", 0) != 0:
            continue
        labels = USED.get(kind.name) or tuple(filter(_CHANNEL.fullmatch, kind.labels))
        for label in labels:
            if label in numbers:
                share = SHARES.get(kind.values[kind.labels.index(label)], 1.0)
                series[f"{kind.name}.{label}"].append((numbers["TimeUS"] * 1e-6, numbers[label] * share))
    return series, servos


def rudder_of(series: Series, servos: dict[int, dict[str, float]], notes: list[str]) -> list[Pair]:
    """Return times and rudder angles: the output of the rudder servo, else the steering command, else none."""
    notes.append("full rudder is assumed to be 45 deg, as in ArduPilot: K is wrong by the ratio to the real angle")
    for number, servo in sorted(servos.items()):
        pairs = rising(series[f"RCOU.C{number}"])
        if servo.get("FUNCTION") == GROUND_STEERING and len(pairs) >= MIN_ROWS:
            middle, low, high = (servo.get(name, usual) for name, usual in USUAL_PULSES.items())
            unit = FULL_RUDDER_RAD * (-1.0 if servo.get("REVERSED", 0.0) else 1.0)
            reach = {True: max(high - middle, 1.0), False: max(middle - low, 1.0)}
            notes.append(f"the output of SERVO{number} is used as rudder angle, so T includes the servo lag")
            return [(time_s, unit * (pulse - middle) / reach[pulse > middle]) for time_s, pulse in pairs if pulse > 0]
    for name in ("STER", "STEE"):
        pairs = rising(series[f"{name}.SteerOut"])
        if len(pairs) >= MIN_ROWS:
            notes.append(f"{name}.SteerOut is used as rudder angle, so T includes the servo lag")
            return [(time_s, CENTIDEGREES_RAD * value) for time_s, value in pairs]
    return []


def _rate(series: Series, time_s: Floats) -> Floats | None:
    """Return the yaw rate at these times, None without a complete one."""
    for name in ("RATE.Y", "STER.TurnRate", "STEE.TurnRate"):
        pairs = np.array(rising(series[name]), dtype=np.float64).reshape(-1, 2)
        if pairs.shape[0] >= PRESENT_SHARE * time_s.size:
            return np.asarray(np.interp(time_s, pairs[:, 0], pairs[:, 1]) * radians(1.0))
    return None
