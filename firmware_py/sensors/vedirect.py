"""Driver of a Victron charger or battery monitor on its VE.Direct port, which it only reads."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceHealth, DeviceRole, PowerSample
from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.sensor_driver import SensorDriver
from firmware_py.sensors.vedirect_blocks import CAPTURE_FORMAT, Block, BlockFramer, Measurement, read_measurement

SILENT_AFTER_S = 5.0  # one block per second; every second block of a monitor contains its history


@dataclass(frozen=True, slots=True)
class VeDirectOptions:
    """No options: the device is configured with the tools of the manufacturer."""


class VeDirectPower(SensorDriver[PowerSample]):
    """Returns one sample per block with measurements, of any device type."""

    def __init__(self, line: ByteLine) -> None:
        """Store the line."""
        super().__init__(line, DeviceRole.POWER, SILENT_AFTER_S)
        self._framer = BlockFramer()
        self._fault = ""

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s."""
        if self._monitor.notice_reopening():
            self._framer = BlockFramer()
            self._fault = ""
        data = self._line.read()
        if not data:
            return
        self._monitor.note_bytes(now_s)
        for block in self._framer.feed(data):
            self._handle_block(block, now_s)

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state; every valid block counts as accepted; FAULTY while a charger reports an error."""
        return self._monitor.health(now_s, self._fault)

    def _handle_block(self, block: Block, now_s: float) -> None:
        if block.fault:
            self._monitor.reject(now_s, block.fault)
            return
        try:
            measurement = read_measurement(block)
        except MessageError as error:
            self._monitor.reject(now_s, str(error))
            return
        self._monitor.accept(now_s)
        if measurement is not None:
            self._fault = f"charger reports error {measurement.error}" if measurement.error else ""
            self._monitor.note(f"alarm, reason code {measurement.alarm}" if measurement.alarm else "")
            self._samples.append(_make_sample(measurement, now_s))


def _make_sample(measurement: Measurement, now_s: float) -> PowerSample:
    return PowerSample(
        t_s=now_s,
        voltage_v=measurement.voltage_v,
        current_a=measurement.current_a,
        charge=measurement.charge,
        solar_w=measurement.solar_w,
        load_a=measurement.load_a,
        temperature_c=measurement.temperature_c,
    )


DRIVER = Driver(
    interface=INTERFACE,
    device="Victron chargers and battery monitors with VE.Direct (MPPT, SmartShunt, BMV)",
    options=VeDirectOptions,
    make=lambda line, _options: VeDirectPower(line),
    capture=CAPTURE_FORMAT,
)
