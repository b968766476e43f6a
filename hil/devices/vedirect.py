"""A Victron charger or battery monitor that sends text blocks on its VE.Direct port, one a second.

Currents and powers are means since the previous block, as in the converters of such devices. Resolutions are those of
the protocol: 1 mV, 1 mA, 1 W, 0.1 %.
"""

from __future__ import annotations

from enum import Enum
from typing import Protocol

from hil.devices.timing import Pace, Transmitter

PERIOD_S = 1.0
_CHECKSUM = b"\r\nChecksum\t"


class Flows(Protocol):
    """Energy and charge since the start, in joules and coulombs."""

    @property
    def panel_j(self) -> float:
        """Energy from the panels."""

    @property
    def charger_j(self) -> float:
        """Energy from the charger."""

    @property
    def into_battery_j(self) -> float:
        """Energy into the battery."""

    @property
    def out_of_battery_j(self) -> float:
        """Energy from the battery."""

    @property
    def battery_c(self) -> float:
        """Net charge into the battery."""

    @property
    def load_c(self) -> float:
        """Charge into the loads."""


class Plant(Protocol):
    """Panels, battery and loads."""

    @property
    def voltage_v(self) -> float:
        """Voltage of the battery."""

    @property
    def panel_v(self) -> float:
        """Voltage of the panels."""

    @property
    def charge(self) -> float:
        """State of charge, 0 to 1."""

    @property
    def totals(self) -> Flows:
        """Energy and charge so far."""

    def advance_to(self, now_s: float) -> None:
        """Advance to a time."""


class Kind(Enum):
    """The kind of the device."""

    CHARGER = "charger"  # the loads are on the battery
    CHARGER_WITH_LOAD = "charger with the loads on its load output"
    MONITOR = "monitor"


def encode_block(fields: dict[str, object]) -> bytes:
    """Return a complete block with its checksum."""
    body = b"".join(f"\r\n{label}\t{value}".encode("ascii") for label, value in fields.items()) + _CHECKSUM
    return body + bytes([-sum(body) & 0xFF])


class VeDirectEmulator:
    """A device on a power plant.

    `error` is the error code of a charger; without `is_soc_known` a monitor reports no state of charge.
    """

    def __init__(
        self, plant: Plant, kind: Kind, *, phase_s: float = 0.0, frequency_error_ppm: float = 0.0, baud: int = 19200
    ) -> None:
        """Start at phase_s."""
        self.plant = plant
        self.error = 0
        self.is_soc_known = True
        self._kind = kind
        self._pace = Pace(PERIOD_S, start_s=phase_s, error_ppm=frequency_error_ppm)
        self.transmitter = Transmitter(baud)
        self._previous = (0.0, plant.totals)  # time and totals of the last block
        self._history_is_due = False

    def receive(self, now_s: float, data: bytes) -> None:
        """Ignore input."""

    def next_output_s(self) -> float:
        """Return when the next block is due or complete."""
        return min(self._pace.next_s, self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Take the measurements that are due and return the complete blocks."""
        for block_s in self._pace.take(now_s):
            self.plant.advance_to(block_s)
            self.transmitter.send(block_s, self._measure(block_s))
        return self.transmitter.take(now_s)

    def _measure(self, block_s: float) -> bytes:
        """Return the block for the time since the previous one; energies (H17 to H22) are in 0.01 kWh."""
        totals, voltage_v = self.plant.totals, self.plant.voltage_v
        previous_s, previous = self._previous
        # The plant advances by whole seconds: one in each period, or none with a fast clock.
        elapsed_s = max(1.0, float(int(block_s) - int(previous_s)))
        self._previous = (block_s, totals)
        battery_a = (totals.battery_c - previous.battery_c) / elapsed_s
        load_a = (totals.load_c - previous.load_c) / elapsed_s
        millivolts = round(voltage_v * 1e3)
        if self._kind is Kind.MONITOR:
            return self._monitor_blocks(millivolts, battery_a, totals)
        with_load = self._kind is Kind.CHARGER_WITH_LOAD
        panel_w = (totals.panel_j - previous.panel_j) / elapsed_s
        return encode_block(
            {
                "PID": "0xA053",
                "FW": "161",
                "SER#": "HQ2140RAMBL",
                "V": millivolts,
                "I": round((battery_a if with_load else battery_a + load_a) * 1e3),
                "VPV": round(self.plant.panel_v * 1e3),
                "PPV": round(panel_w),
                "CS": 3 if panel_w > 0.5 else 0,  # bulk, off
                "MPPT": 2 if panel_w > 0.5 else 0,  # active, off
                "OR": "0x00000000" if panel_w > 0.5 else "0x00000001",  # reason for off: no input power
                "ERR": self.error,
                **({"LOAD": "ON", "IL": round(load_a * 1e3)} if with_load else {}),
                "H19": round(totals.charger_j / 36e3),
                "H20": round(totals.charger_j / 36e3),
                "H21": 0,
                "H22": 0,
                "H23": 0,
                "HSDS": 0,
            }
        )

    def _monitor_blocks(self, millivolts: int, battery_a: float, totals: Flows) -> bytes:
        measured = encode_block(
            {
                "PID": "0xA389",
                "V": millivolts,
                "VS": 12,
                "I": round(battery_a * 1e3),
                "P": round(battery_a * millivolts * 1e-3),
                "CE": round(min(0.0, totals.battery_c) / 3.6),
                "SOC": round(self.plant.charge * 1e3) if self.is_soc_known else "---",
                "TTG": -1,
                "Alarm": "OFF",
                "AR": 0,
                "BMV": "SmartShunt 500A/50mV",
                "FW": "0413",
                "MON": 0,
            }
        )
        self._history_is_due = not self._history_is_due
        if not self._history_is_due:
            return measured
        return measured + encode_block(
            {
                "H1": 0,
                "H7": millivolts,
                "H8": millivolts,
                "H17": round(totals.out_of_battery_j / 36e3),
                "H18": round(totals.into_battery_j / 36e3),
            }
        )
