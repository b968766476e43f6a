"""The thin log: a row per minute and per event, small enough for a year.

A row has the values since the previous row in SI units and radians, NaN for unknown ones. The format is DataFlash, like
the full log.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import msgspec

from firmware_py.common.records import Event, Inputs
from firmware_py.common.reports import Flow, Output, Power, Snapshot
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.log import ardupilot
from firmware_py.log.dataflash import header
from firmware_py.log.message_rows import Column, Row, flag, real, whole

INTERVAL_S: Final = 60.0
# Limits for event rows and texts: a fault that toggles a thousand times an hour must not fill the log.
MAX_BURST_ROWS: Final = 20.0
EVENT_ROWS_HZ: Final = 1.0 / 120.0


class Minute(msgspec.Struct, frozen=True):
    """The values of a row over `span_s`; None if unknown.

    Faults are all that were active in the span, as bits. Solar and load power and the battery current are means of the
    span; other quantities without a sum or mean are the last values.
    """

    utc_s: float
    span_s: float
    mode: int
    armed: bool
    faults: int
    latitude_rad: float | None = None
    longitude_rad: float | None = None
    speed_over_ground_m_s: float | None = None
    heading_rad: float | None = None
    mean_error_rad: float | None = None
    rms_error_rad: float | None = None
    travel_rad: float | None = None
    speed_m_s: float | None = None
    wave_period_s: float | None = None
    wave_sd_rad: float | None = None
    current_north_m_s: float | None = None
    current_east_m_s: float | None = None
    steering_j: float | None = None
    servo_c: float | None = None
    compass_c: float | None = None
    servo_v: float | None = None
    battery_v: float | None = None
    battery_a: float | None = None
    charge: float | None = None
    solar_w: float | None = None
    load_w: float | None = None
    skipped: int = 0
    lost: int = 0


def _maybe(label: str, unit: str, field: str) -> Column:
    return Column(label, "f", unit, "0" if unit != "-" else "-", field, math.nan)


def _exact(label: str, unit: str, field: str) -> Column:
    return Column(label, "d", unit, "0", field, math.nan)


SAILING: Final = Row(
    170,
    "THIN",
    (
        real("Utc", "s", "utc_s"),
        _maybe("Sec", "s", "span_s"),
        whole("Mod", "B", "mode"),
        flag("Arm", "armed"),
        whole("Flt", "Q", "faults"),
        _exact("Lat", "r", "latitude_rad"),
        _exact("Lng", "r", "longitude_rad"),
        _maybe("Sog", "n", "speed_over_ground_m_s"),
        _maybe("Hdg", "r", "heading_rad"),
        _maybe("Err", "r", "mean_error_rad"),
        _maybe("Rms", "r", "rms_error_rad"),
        _maybe("Trv", "r", "travel_rad"),
        _maybe("U", "n", "speed_m_s"),
        _maybe("WT", "s", "wave_period_s"),
        _maybe("WSd", "r", "wave_sd_rad"),
    ),
    Minute,
)
UPKEEP: Final = Row(
    171,
    "THNE",
    (
        _maybe("CN", "n", "current_north_m_s"),
        _maybe("CE", "n", "current_east_m_s"),
        _maybe("Enr", "J", "steering_j"),
        _maybe("TSrv", "O", "servo_c"),
        _maybe("TCmp", "O", "compass_c"),
        _maybe("VSrv", "v", "servo_v"),
        _maybe("BatV", "v", "battery_v"),
        _maybe("BatA", "A", "battery_a"),
        _maybe("SoC", "-", "charge"),
        _maybe("Sun", "W", "solar_w"),
        _maybe("Load", "W", "load_w"),
        whole("Skip", "I", "skipped"),
        whole("Lost", "I", "lost"),
    ),
    Minute,
)
TYPES: Final = (SAILING.type, UPKEEP.type, ardupilot.MSG)
HEAD: Final = header(TYPES, 0)


@dataclass(slots=True)
class _Span:
    """The values accumulated for the next row."""

    begin_s: float
    faults: int = 0
    count: int = 0
    error_rad: float = 0.0
    square: float = 0.0
    compass_c: float | None = None

    def add(self, inputs: Inputs, boat: Snapshot) -> None:
        """Add a tick."""
        self.faults |= boat.faults
        error_rad = boat.heading_error_rad
        if error_rad is not None:
            self.count += 1
            self.error_rad += error_rad
            self.square += error_rad * error_rad
        if inputs.headings and inputs.headings[-1].temperature_c is not None:
            self.compass_c = inputs.headings[-1].temperature_c


class _Sums(msgspec.Struct, frozen=True):
    """Sums since the start of the program; a row has the difference."""

    travel_rad: float = 0.0
    energy_j: float = 0.0
    skipped: int = 0
    power: Power = Power()

    @classmethod
    def of(cls, boat: Snapshot) -> _Sums:
        energy, power = boat.energy, boat.power or Power()
        if energy is None:
            return cls(skipped=boat.skipped_total, power=power)
        return cls(energy.travel_rad, energy.energy_j, boat.skipped_total, power)


def _mean_w(now: Flow, before: Flow) -> float | None:
    """Return the mean power between two sums, None if not measured."""
    measured_s = now.measured_s - before.measured_s
    return (now.energy_j - before.energy_j) / measured_s if measured_s > 0.0 else None


def _power(now: Power, before: Power) -> dict[str, float | None]:
    """Return the fields of battery, solar power and load."""
    charged_w, discharged_w = _mean_w(now.charged, before.charged), _mean_w(now.discharged, before.discharged)
    battery_a = None
    if charged_w is not None and discharged_w is not None and now.voltage_v:
        battery_a = (charged_w - discharged_w) / now.voltage_v  # voltage times current is the mean power
    return {
        "battery_v": now.voltage_v,
        "battery_a": battery_a,
        "charge": now.charge,
        "solar_w": _mean_w(now.solar, before.solar),
        "load_w": _mean_w(now.load, before.load),
    }


class ThinLog:
    """Builds the rows of the thin log, tick by tick."""

    def __init__(self, utc_s: Callable[[], float], opening: tuple[Event, ...] = ()) -> None:
        """Store the computer's clock and the events logged at each start."""
        self._utc_s = utc_s
        self._opening = opening
        self._allowance = TokenBucket(MAX_BURST_ROWS, EVENT_ROWS_HZ)
        self._span: _Span | None = None
        self._sums = _Sums()
        self._state: tuple[int, bool, int] | None = None  # mode, armed and faults of the previous row
        self._lost = 0

    def update(self, inputs: Inputs, output: Output) -> bytes:
        """Add a tick and return the rows that it completes, mostly none; raises struct.error or similar."""
        t_s, boat = inputs.tick.t_s, output.snapshot
        data, events = b"", output.events
        span = self._span
        if span is None:
            span = self._span = _Span(t_s)
            events = (*self._opening, *events)
        span.add(inputs, boat)
        if events:
            allowed = [event for event in events if self._allowance.spend_one(t_s)]
            self._lost += len(events) - len(allowed)
            data = ardupilot.message_bytes(t_s, allowed)
        state = (boat.mode, boat.armed, boat.faults)
        if t_s - span.begin_s >= INTERVAL_S or (state != self._state and self._allowance.spend_one(t_s)):
            minute = self._minute(span, boat, t_s)
            data += SAILING.pack(t_s, minute) + UPKEEP.pack(t_s, minute)
            self._span, self._sums, self._state, self._lost = _Span(t_s), _Sums.of(boat), state, 0
        return data

    def _minute(self, span: _Span, boat: Snapshot, t_s: float) -> Minute:
        sums, before, count = _Sums.of(boat), self._sums, span.count
        fix = boat.position if boat.position_ok else None
        servo, sea, water = boat.servo, boat.estimate, boat.water
        return Minute(
            utc_s=self._utc_s(),
            span_s=t_s - span.begin_s,
            mode=boat.mode,
            armed=boat.armed,
            faults=span.faults,
            latitude_rad=None if fix is None else fix.latitude_rad,
            longitude_rad=None if fix is None else fix.longitude_rad,
            speed_over_ground_m_s=None if fix is None else fix.speed_over_ground_m_s,
            heading_rad=boat.heading_rad if boat.heading_ok else None,
            mean_error_rad=span.error_rad / count if count else None,
            rms_error_rad=math.sqrt(span.square / count) if count else None,
            travel_rad=sums.travel_rad - before.travel_rad,
            speed_m_s=None if water is None else water.speed_m_s,
            wave_period_s=None if sea is None else sea.wave_period_s,
            wave_sd_rad=None if sea is None else sea.wave_sd_rad,
            current_north_m_s=None if water is None else water.current_north_m_s,
            current_east_m_s=None if water is None else water.current_east_m_s,
            steering_j=sums.energy_j - before.energy_j,
            servo_c=None if servo is None else servo.temperature_c,
            compass_c=span.compass_c,
            servo_v=None if servo is None else servo.voltage_v,
            **_power(sums.power, before.power),
            skipped=sums.skipped - before.skipped,
            lost=self._lost,
        )
