"""An Iridium 9602 on its serial port: AT commands of Short Burst Data, byte by byte.

Written from the ISU AT Command Reference, independent of the driver.
"""

from __future__ import annotations

import math
import struct

from hil.devices.iridium_network import IridiumNetwork
from hil.devices.timing import Transmitter

_REPLY_S = 0.02  # delay of a reply to a simple command
_SIGNAL_S = 1.5  # duration of a signal measurement
_RING_S = 1.0  # interval of checks for an alert
_WRITE_S = 60.0  # after READY
_MAX_MESSAGE_BYTES = 340


class IridiumModem:
    """The modem with its `imei`. Factory settings: echo on, alerts off."""

    def __init__(self, network: IridiumNetwork, *, imei: str = "300234010753370", baud: int = 19200) -> None:
        """Start powered."""
        self.network = network
        self.imei = imei
        self._line = Transmitter(baud)
        self._in = b""
        self._echo, self._alerts, self._ringing = True, False, False
        self._out_message = self._in_message = b""
        self._out_number, self._in_number = 0, 0
        self._waiting = 0
        self._awaited: tuple[float, int] | None = None  # deadline and size of a message
        self._busy_until_s = -math.inf
        self._ring_s = 0.0

    def receive(self, now_s: float, data: bytes) -> None:
        """Process bytes; during a session they are ignored."""
        if now_s < self._busy_until_s:
            return
        self._in += data
        while self._in:
            if self._awaited is not None:
                if not self._read_message(now_s):
                    return
                continue
            command, end, rest = self._in.partition(b"\r")
            if not end:
                self._in = self._in[-200:]
                return
            self._in = rest
            if self._echo:
                self._send(now_s, command + b"\r")
            self._execute(now_s, command.strip().upper())

    def next_output_s(self) -> float:
        """Return when the next output is complete, or the next check for an alert."""
        return min(self._line.next_s(), self._ring_s)

    def take_output(self, now_s: float) -> bytes:
        """Return the complete output."""
        while self._ring_s <= now_s:
            if self._alerts and self._ring_s >= self._busy_until_s and self.network.take_ring(self._ring_s):
                self._ringing = True
                self._send(self._ring_s, b"\r\nSBDRING\r\n")
            self._ring_s += max(_RING_S, math.floor(now_s - self._ring_s))
        return self._line.take(now_s)

    # ------------------------------------------------------------------

    def _send(self, at_s: float, data: bytes) -> None:
        self._line.send(at_s, data)

    def _answer(self, at_s: float, text: str = "", end: str = "OK") -> None:
        head = f"\r\n{text}\r\n" if text else ""
        self._send(at_s, f"{head}\r\n{end}\r\n".encode())

    def _read_message(self, now_s: float) -> bool:
        assert self._awaited is not None  # noqa: S101 - for the type checker
        until_s, size = self._awaited
        if now_s > until_s:
            self._awaited = None
            self._answer(now_s, "1")
            return True
        if len(self._in) < size + 2:
            return False
        message, checksum = self._in[:size], self._in[size : size + 2]
        self._in, self._awaited = self._in[size + 2 :], None
        is_valid = struct.pack(">H", sum(message) % 65536) == checksum
        if is_valid:
            self._out_message = message
        self._answer(now_s + _REPLY_S, "0" if is_valid else "2")
        return True

    def _execute(self, now_s: float, command: bytes) -> None:
        at_s = now_s + _REPLY_S
        name, _, value = command.partition(b"=")
        if name in (b"AT", b"AT&K0", b"AT+SBDDET"):
            self._answer(at_s)
        elif name in (b"ATE0", b"ATE1"):
            self._echo = name == b"ATE1"
            self._answer(at_s)
        elif name == b"AT+SBDMTA" and value in (b"0", b"1"):
            self._alerts = value == b"1"
            self._answer(at_s)
        elif name == b"AT+CGSN":
            self._answer(at_s, self.imei)
        elif name in (b"AT+CSQ", b"AT+CSQF"):
            self._answer(now_s + (_SIGNAL_S if name == b"AT+CSQ" else _REPLY_S), f"+CSQ:{self.network.signal(now_s)}")
        elif name == b"AT+SBDWB" and value.isdigit():
            self._expect(now_s, int(value))
        elif name == b"AT+SBDRB":
            content = self._in_message
            self._send(at_s, struct.pack(">H", len(content)) + content + struct.pack(">H", sum(content) % 65536))
            self._answer(at_s)
        elif name in (b"AT+SBDD0", b"AT+SBDD1", b"AT+SBDD2"):
            self._out_message = b"" if name[-1:] in b"02" else self._out_message
            self._in_message = b"" if name[-1:] in b"12" else self._in_message
            self._answer(at_s, "0")
        elif name == b"AT+SBDSX":
            fields = (bool(self._out_message), self._out_number, bool(self._in_message))
            more = (self._in_number if self._in_message else -1, self._ringing, self._waiting)
            self._answer(at_s, "+SBDSX: " + ", ".join(str(int(field)) for field in (*fields, *more)))
        elif name in (b"AT+SBDIX", b"AT+SBDIXA"):
            self._call(now_s)
        else:
            self._answer(at_s, end="ERROR")

    def _expect(self, now_s: float, size: int) -> None:
        if not 1 <= size <= _MAX_MESSAGE_BYTES:
            self._answer(now_s + _REPLY_S, "3")
            return
        self._awaited = (now_s + _WRITE_S, size)
        self._send(now_s + _REPLY_S, b"\r\nREADY\r\n")

    def _call(self, now_s: float) -> None:
        outcome = self.network.session(now_s, self._out_number, self._out_message)
        self._busy_until_s = now_s + outcome.duration_s
        number, received, length = self._out_number, 0, 0
        if outcome.counted:
            self._out_number = (self._out_number + 1) & 0xFFFF
            self._ringing = False
            self._waiting = outcome.waiting
        if outcome.message is not None:
            self._in_number, self._in_message = outcome.message
            received, length = 1, len(self._in_message)
        fields = (outcome.status, number, received, self._in_number, length, outcome.waiting)
        self._answer(self._busy_until_s, "+SBDIX: " + ", ".join(map(str, fields)))
