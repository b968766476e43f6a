"""Driver of a flight controller (ArduPilot, PX4) as battery monitor, over MAVLink.

Source: the definitions of BATTERY_STATUS and SYS_STATUS in common.xml.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import option
from firmware_py.common.records import DeviceRole, PowerSample
from firmware_py.sensors.mavlink_board import (
    POWER_COMPONENT,
    MavlinkDevice,
    MavlinkOptions,
    Wanted,
)
from firmware_py.sensors.mavlink_frames import Frame, Message, Stream
from firmware_py.sensors.message_error import check_range

RATE_HZ = 1.0
SILENT_AFTER_S = 5.0
SUMMARY_AFTER_S = 5.0  # SYS_STATUS is used if there has been no BATTERY_STATUS for this time

_BATTERY_ID_FIELD = 14  # of BATTERY_STATUS, in the order of the payload
_UNKNOWN_U16, _UNKNOWN_TEMPERATURE, _UNKNOWN_CURRENT, _UNKNOWN_CHARGE = 0xFFFF, 0x7FFF, -1, -1


@dataclass(frozen=True, slots=True)
class MavlinkPowerOptions(MavlinkOptions):
    """Options of the vehicle file for a flight controller as battery monitor; raises ValueError."""

    battery: int = option("number of the battery (id of BATTERY_STATUS)", default=0, minimum=0, maximum=255)


class MavlinkPower(MavlinkDevice[PowerSample]):
    """Returns one sample for each BATTERY_STATUS of the battery.

    For battery 0, each SYS_STATUS gives a sample after SUMMARY_AFTER_S without BATTERY_STATUS. Every valid message
    about the battery counts as accepted.
    """

    def __init__(self, line: ByteLine, options: MavlinkPowerOptions) -> None:
        """Store line and options."""
        wanted = (
            Wanted(Message.BATTERY_STATUS, RATE_HZ, Stream.EXTRA3),
            Wanted(Message.SYS_STATUS, RATE_HZ, Stream.EXTENDED_STATUS),
        )
        super().__init__(line, options, DeviceRole.POWER, POWER_COMPONENT, wanted, SILENT_AFTER_S)
        self._battery = options.battery
        self._status_s: float | None = None  # time of the last BATTERY_STATUS of the battery

    def _handle(self, frame: Frame, now_s: float) -> None:
        self._monitor.note_unused("connected, no battery yet")
        if frame.message is Message.BATTERY_STATUS:
            if frame.fields[_BATTERY_ID_FIELD] == self._battery:
                sample = read_battery(frame.fields, now_s)
                self._status_s = now_s
                self._add(sample, now_s)
        elif frame.message is Message.SYS_STATUS and self._battery == 0 and self._has_only_summary(now_s):
            self._add(read_summary(frame.fields, now_s), now_s)

    def _has_only_summary(self, now_s: float) -> bool:
        return self._status_s is None or now_s - self._status_s > SUMMARY_AFTER_S

    def _add(self, sample: PowerSample, now_s: float) -> None:
        self._monitor.accept(now_s)
        is_measured = sample.voltage_v is not None or sample.charge is not None
        self._monitor.note(self._board.other_text if is_measured else "battery not measured")
        if is_measured:
            self._samples.append(sample)


def read_battery(fields: tuple[int, ...], now_s: float) -> PowerSample:
    """Return the sample of a BATTERY_STATUS; raises MessageError for a value that is out of range.

    The voltage is the sum of the cells; a flight controller that does not measure cells sends the voltage of the
    battery as one cell, or divided among several because of the range of a field.
    """
    temperature, cells = fields[2], fields[3:13]
    current_ca, remaining_percent, more_cells = fields[13], fields[17], fields[20:24]
    millivolts = sum(cell for cell in (*cells, *more_cells) if cell != _UNKNOWN_U16)
    temperature_c = None if temperature == _UNKNOWN_TEMPERATURE else temperature * 1e-2
    return _make_sample(millivolts, current_ca, remaining_percent, temperature_c, now_s)


def read_summary(fields: tuple[int, ...], now_s: float) -> PowerSample:
    """Return the sample of a SYS_STATUS; raises MessageError for a value that is out of range."""
    millivolts, current_ca, remaining_percent = fields[4], fields[5], fields[12]
    return _make_sample(0 if millivolts == _UNKNOWN_U16 else millivolts, current_ca, remaining_percent, None, now_s)


def _make_sample(
    millivolts: int, current_ca: int, remaining_percent: int, temperature_c: float | None, now_s: float
) -> PowerSample:
    """Return a sample; `current_ca` [0.01 A] is positive in a discharge, unlike in a sample. 0 mV: not measured."""
    return PowerSample(
        t_s=now_s,
        voltage_v=None if millivolts == 0 else millivolts * 1e-3,
        current_a=None if current_ca == _UNKNOWN_CURRENT else current_ca * -1e-2,
        charge=None
        if remaining_percent == _UNKNOWN_CHARGE
        else check_range(remaining_percent * 1e-2, 0.0, 1.0, "charge"),
        temperature_c=None if temperature_c is None else check_range(temperature_c, -100.0, 150.0, "temperature"),
    )


DRIVER = Driver(
    interface=INTERFACE,
    device="flight controllers (ArduPilot, PX4) over MAVLink",
    options=MavlinkPowerOptions,
    make=MavlinkPower,
    writes=True,
)
