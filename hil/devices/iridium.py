"""An Iridium 9602 modem: AT commands of Short Burst Data on its serial port.

Written from the ISU AT Command Reference, independent of the driver.
"""

from __future__ import annotations

import math
import struct

from hil.devices.iridium_network import IridiumNetwork
from hil.devices.timing import Transmitter

_REPLY_S = 0.02  # delay of a reply to a simple command
_SIGNAL_S = 1.5  # duration of a signal measurement
_ALERT_CHECK_S = 1.0  # interval of checks for a ring alert
_WRITE_TIMEOUT_S = 60.0  # for a message, after READY
_MAX_MESSAGE_BYTES = 340


class IridiumModem:
    """The modem. Factory settings: echo on, alerts off."""

    def __init__(self, network: IridiumNetwork, *, imei: str = "300234010753370", baud: int = 19200) -> None:
        """Start powered."""
        self.network = network
        self.imei = imei
        self._line = Transmitter(baud)
        self._received = b""
        self._has_echo, self._has_alerts, self._is_ringing = True, False, False
        self._out_message = self._in_message = b""
        self._out_number, self._in_number = 0, 0  # MOMSN, MTMSN
        self._queued = 0  # messages for the boat at the gateway
        self._expected_message: tuple[float, int] | None = None  # deadline and size of a message
        self._busy_until_s = -math.inf
        self._next_alert_check_s = 0.0

    def receive(self, now_s: float, data: bytes) -> None:
        """Process bytes; during a session they are ignored."""
        if now_s < self._busy_until_s:
            return
        self._received += data
        while self._received:
            if self._expected_message is not None:
                if not self._read_message(now_s):
                    return
                continue
            command, end, rest = self._received.partition(b"\r")
            if not end:
                self._received = self._received[-200:]
                return
            self._received = rest
            if self._has_echo:
                self._send(now_s, command + b"\r")
            self._execute(now_s, command.strip().upper())

    def next_output_s(self) -> float:
        """Return when the next output is complete, or the next check for an alert."""
        return min(self._line.next_s(), self._next_alert_check_s)

    def take_output(self, now_s: float) -> bytes:
        """Return the complete output."""
        while self._next_alert_check_s <= now_s:
            is_free = self._next_alert_check_s >= self._busy_until_s
            if self._has_alerts and is_free and self.network.take_alert(self._next_alert_check_s):
                self._is_ringing = True
                self._send(self._next_alert_check_s, b"\r\nSBDRING\r\n")
            self._next_alert_check_s += max(_ALERT_CHECK_S, math.floor(now_s - self._next_alert_check_s))
        return self._line.take(now_s)

    # ------------------------------------------------------------------

    def _send(self, at_s: float, data: bytes) -> None:
        self._line.send(at_s, data)

    def _reply(self, at_s: float, text: str = "", end: str = "OK") -> None:
        head = f"\r\n{text}\r\n" if text else ""
        self._send(at_s, f"{head}\r\n{end}\r\n".encode())

    def _read_message(self, now_s: float) -> bool:
        """Read the message after AT+SBDWB; return False if it is incomplete.

        Replies: 0 accepted, 1 timeout, 2 wrong checksum (and 3, wrong length, in _expect).
        """
        assert self._expected_message is not None  # noqa: S101 - for the type checker
        deadline_s, size = self._expected_message
        if now_s > deadline_s:
            self._expected_message = None
            self._reply(now_s, "1")
            return True
        if len(self._received) < size + 2:
            return False
        message, checksum = self._received[:size], self._received[size : size + 2]
        self._received, self._expected_message = self._received[size + 2 :], None
        is_valid = struct.pack(">H", sum(message) % 65536) == checksum
        if is_valid:
            self._out_message = message
        self._reply(now_s + _REPLY_S, "0" if is_valid else "2")
        return True

    def _execute(self, now_s: float, command: bytes) -> None:
        at_s = now_s + _REPLY_S
        name, _, value = command.partition(b"=")
        if name in (b"AT", b"AT&K0", b"AT+SBDDET"):
            self._reply(at_s)
        elif name in (b"ATE0", b"ATE1"):
            self._has_echo = name == b"ATE1"
            self._reply(at_s)
        elif name == b"AT+SBDMTA" and value in (b"0", b"1"):
            self._has_alerts = value == b"1"
            self._reply(at_s)
        elif name == b"AT+CGSN":
            self._reply(at_s, self.imei)
        elif name in (b"AT+CSQ", b"AT+CSQF"):
            self._reply(now_s + (_SIGNAL_S if name == b"AT+CSQ" else _REPLY_S), f"+CSQ:{self.network.signal(now_s)}")
        elif name == b"AT+SBDWB" and value.isdigit():
            self._expect(now_s, int(value))
        elif name == b"AT+SBDRB":
            content = self._in_message
            self._send(at_s, struct.pack(">H", len(content)) + content + struct.pack(">H", sum(content) % 65536))
            self._reply(at_s)
        elif name in (b"AT+SBDD0", b"AT+SBDD1", b"AT+SBDD2"):
            self._out_message = b"" if name[-1:] in b"02" else self._out_message
            self._in_message = b"" if name[-1:] in b"12" else self._in_message
            self._reply(at_s, "0")
        elif name == b"AT+SBDSX":
            fields = (bool(self._out_message), self._out_number, bool(self._in_message))
            more = (self._in_number if self._in_message else -1, self._is_ringing, self._queued)
            self._reply(at_s, "+SBDSX: " + ", ".join(str(int(field)) for field in (*fields, *more)))
        elif name in (b"AT+SBDIX", b"AT+SBDIXA"):
            self._run_session(now_s)
        else:
            self._reply(at_s, end="ERROR")

    def _expect(self, now_s: float, size: int) -> None:
        if not 1 <= size <= _MAX_MESSAGE_BYTES:
            self._reply(now_s + _REPLY_S, "3")
            return
        self._expected_message = (now_s + _WRITE_TIMEOUT_S, size)
        self._send(now_s + _REPLY_S, b"\r\nREADY\r\n")

    def _run_session(self, now_s: float) -> None:
        outcome = self.network.run_session(now_s, self._out_number, self._out_message)
        self._busy_until_s = now_s + outcome.duration_s
        number, received, length = self._out_number, 0, 0
        if outcome.increments_number:
            self._out_number = (self._out_number + 1) & 0xFFFF
            self._is_ringing = False
            self._queued = outcome.queued
        if outcome.message is not None:
            self._in_number, self._in_message = outcome.message
            received, length = 1, len(self._in_message)
        fields = (outcome.status, number, received, self._in_number, length, outcome.queued)
        self._reply(self._busy_until_s, "+SBDIX: " + ", ".join(map(str, fields)))
