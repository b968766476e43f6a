"""The thin log: a row per minute and per event, small enough to store a year.

A row contains the values since the previous row in SI units and radians, NaN for unknown values. The format is
DataFlash, as of the full log.
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
from firmware_py.log.message_rows import Column, Row, flag_column, float_column, integer_column

INTERVAL_S: Final = 60.0
# Limits for rows and texts of events, because a fault may toggle a thousand times per hour.
MAX_BURST_ROWS: Final = 20.0
MAX_EVENT_ROWS_HZ: Final = 1.0 / 120.0


class Minute(msgspec.Struct, frozen=True):
    """The values of a row over the interval `span_s`; None if unknown.

    `faults` are the bits of all faults that were active in the interval. Solar and load power, battery current and
    heading error are means, `travel_rad`, `steering_j`, `skipped` (missed deadlines) and `lost` (texts of events beyond
    the limit) sums of the interval; the others are last values.
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


def _single_column(label: str, unit: str, field: str) -> Column:
    return Column(label, "f", unit, "0" if unit != "-" else "-", field, math.nan)


def _double_column(label: str, unit: str, field: str) -> Column:
    return Column(label, "d", unit, "0", field, math.nan)


SAILING: Final = Row(
    170,
    "THIN",
    (
        float_column("Utc", "s", "utc_s"),
        _single_column("Sec", "s", "span_s"),
        integer_column("Mod", "B", "mode"),
        flag_column("Arm", "armed"),
        integer_column("Flt", "Q", "faults"),
        _double_column("Lat", "r", "latitude_rad"),
        _double_column("Lng", "r", "longitude_rad"),
        _single_column("Sog", "n", "speed_over_ground_m_s"),
        _single_column("Hdg", "r", "heading_rad"),
        _single_column("Err", "r", "mean_error_rad"),
        _single_column("Rms", "r", "rms_error_rad"),
        _single_column("Trv", "r", "travel_rad"),
        _single_column("U", "n", "speed_m_s"),
        _single_column("WT", "s", "wave_period_s"),
        _single_column("WSd", "r", "wave_sd_rad"),
    ),
    Minute,
)
UPKEEP: Final = Row(
    171,
    "THNE",
    (
        _single_column("CN", "n", "current_north_m_s"),
        _single_column("CE", "n", "current_east_m_s"),
        _single_column("Enr", "J", "steering_j"),
        _single_column("TSrv", "O", "servo_c"),
        _single_column("TCmp", "O", "compass_c"),
        _single_column("VSrv", "v", "servo_v"),
        _single_column("BatV", "v", "battery_v"),
        _single_column("BatA", "A", "battery_a"),
        _single_column("SoC", "-", "charge"),
        _single_column("Sun", "W", "solar_w"),
        _single_column("Load", "W", "load_w"),
        integer_column("Skip", "I", "skipped"),
        integer_column("Lost", "I", "lost"),
    ),
    Minute,
)
TYPES: Final = (SAILING.type, UPKEEP.type, ardupilot.MSG)
HEAD: Final = header(TYPES, 0)


@dataclass(slots=True)
class _Interval:
    """The values accumulated for the next row."""

    begin_s: float
    faults: int = 0
    error_count: int = 0
    error_rad: float = 0.0
    square_rad2: float = 0.0
    compass_c: float | None = None

    def add(self, inputs: Inputs, snapshot: Snapshot) -> None:
        """Add a tick."""
        self.faults |= snapshot.faults
        error_rad = snapshot.heading_error_rad
        if error_rad is not None:
            self.error_count += 1
            self.error_rad += error_rad
            self.square_rad2 += error_rad * error_rad
        for sample in inputs.headings:
            if sample.temperature_c is not None:
                self.compass_c = sample.temperature_c


class _Sums(msgspec.Struct, frozen=True):
    """Sums since the start of the program; a row contains their differences."""

    travel_rad: float = 0.0
    energy_j: float = 0.0
    skipped: int = 0
    power: Power = Power()

    @classmethod
    def from_snapshot(cls, snapshot: Snapshot) -> _Sums:
        energy, power = snapshot.energy, snapshot.power or Power()
        if energy is None:
            return cls(skipped=snapshot.skipped_total, power=power)
        return cls(energy.travel_rad, energy.energy_j, snapshot.skipped_total, power)


def _mean_w(present: Flow, previous: Flow) -> float | None:
    """Return the mean power between two sums of energy, None if it was not measured."""
    measured_s = present.measured_s - previous.measured_s
    return (present.energy_j - previous.energy_j) / measured_s if measured_s > 0.0 else None


def _power_fields(present: Power, previous: Power) -> dict[str, float | None]:
    """Return the fields of battery, solar power and load for a row."""
    charged_w = _mean_w(present.charged, previous.charged)
    discharged_w = _mean_w(present.discharged, previous.discharged)
    battery_a = None
    if charged_w is not None and discharged_w is not None and present.voltage_v:
        battery_a = (charged_w - discharged_w) / present.voltage_v  # so that voltage times current is the mean power
    return {
        "battery_v": present.voltage_v,
        "battery_a": battery_a,
        "charge": present.charge,
        "solar_w": _mean_w(present.solar, previous.solar),
        "load_w": _mean_w(present.load, previous.load),
    }


class ThinLog:
    """Builds the rows of the thin log, tick by tick."""

    def __init__(self, utc_s: Callable[[], float], start_events: tuple[Event, ...] = ()) -> None:
        """Store the clock of the computer and the events to log with the first tick."""
        self._utc_s = utc_s
        self._start_events = start_events
        self._event_budget = TokenBucket(MAX_BURST_ROWS, MAX_EVENT_ROWS_HZ)
        self._interval: _Interval | None = None
        self._sums = _Sums()
        self._last_state: tuple[int, bool, int] | None = None  # mode, armed and faults of the previous row
        self._lost_texts = 0

    def update(self, inputs: Inputs, output: Output) -> bytes:
        """Add a tick and return the messages to log, mostly none; raises struct.error or similar."""
        t_s, snapshot = inputs.tick.t_s, output.snapshot
        data, events = b"", output.events
        interval = self._interval
        if interval is None:
            interval = self._interval = _Interval(t_s)
            events = (*self._start_events, *events)
        interval.add(inputs, snapshot)
        if events:
            events_to_log = [event for event in events if self._event_budget.spend_one(t_s)]
            self._lost_texts += len(events) - len(events_to_log)
            data = ardupilot.encode_texts(t_s, events_to_log)
        state = (snapshot.mode, snapshot.armed, snapshot.faults)
        if t_s - interval.begin_s >= INTERVAL_S or (state != self._last_state and self._event_budget.spend_one(t_s)):
            minute = self._build_minute(interval, snapshot, t_s)
            data += SAILING.pack(t_s, minute) + UPKEEP.pack(t_s, minute)
            self._interval, self._sums = _Interval(t_s), _Sums.from_snapshot(snapshot)
            self._last_state, self._lost_texts = state, 0
        return data

    def _build_minute(self, interval: _Interval, snapshot: Snapshot, t_s: float) -> Minute:
        sums, previous, error_count = _Sums.from_snapshot(snapshot), self._sums, interval.error_count
        fix = snapshot.position if snapshot.position_ok else None
        servo, estimate, water = snapshot.servo, snapshot.estimate, snapshot.water
        return Minute(
            utc_s=self._utc_s(),
            span_s=t_s - interval.begin_s,
            mode=snapshot.mode,
            armed=snapshot.armed,
            faults=interval.faults,
            latitude_rad=None if fix is None else fix.latitude_rad,
            longitude_rad=None if fix is None else fix.longitude_rad,
            speed_over_ground_m_s=None if fix is None else fix.speed_over_ground_m_s,
            heading_rad=snapshot.heading_rad if snapshot.heading_ok else None,
            mean_error_rad=interval.error_rad / error_count if error_count else None,
            rms_error_rad=math.sqrt(interval.square_rad2 / error_count) if error_count else None,
            travel_rad=sums.travel_rad - previous.travel_rad,
            speed_m_s=None if water is None else water.speed_m_s,
            wave_period_s=None if estimate is None else estimate.wave_period_s,
            wave_sd_rad=None if estimate is None else estimate.wave_sd_rad,
            current_north_m_s=None if water is None else water.current_north_m_s,
            current_east_m_s=None if water is None else water.current_east_m_s,
            steering_j=sums.energy_j - previous.energy_j,
            servo_c=None if servo is None else servo.temperature_c,
            compass_c=interval.compass_c,
            servo_v=None if servo is None else servo.voltage_v,
            **_power_fields(sums.power, previous.power),
            skipped=sums.skipped - previous.skipped,
            lost=self._lost_texts,
        )
