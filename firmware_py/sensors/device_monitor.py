"""The state, the counters and the last error of one sensor, for its health record."""

from __future__ import annotations

from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState
from firmware_py.common.sample_timeout import learn_interval_s, timeout_s

SILENT_AFTER_S = 2.0
ERROR_KEPT_S = 10.0  # an old error would hide that all is well again
MAX_TEXT_LENGTH = 60
NO_HEADING_YET = "it answers, but gives no heading yet"


class DeviceMonitor:
    """Judges a device by what its driver reports: it is RUNNING while something good is fresh."""

    def __init__(self, line: ByteLine, role: DeviceRole, silent_after_s: float = SILENT_AFTER_S) -> None:
        """Watch the device of this role on this line; a slow one times out later (common/sample_timeout.py)."""
        self._silent_after_s = silent_after_s
        self._line = line
        self._role = role
        self._openings = -1
        self._accepted = 0
        self._rejected = 0
        self._accepted_s: float | None = None
        self._interval_s = 0.0
        self._bytes_s: float | None = None
        self._passed = ""
        self._note = ""
        self._error = ""
        self._error_s = 0.0

    def notice_reopening(self) -> bool:
        """Say whether the line has been opened since the last call; if so the device starts anew."""
        if self._line.openings == self._openings:
            return False
        self._openings = self._line.openings
        self._accepted_s = self._bytes_s = None
        self._note = self._error = self._passed = ""
        return True

    def note_bytes(self, now_s: float) -> None:
        """Note that bytes have come, of whatever kind."""
        self._bytes_s = now_s

    def pass_over(self, text: str) -> None:
        """Keep what to say of whole messages that are of no use, while no other ones come."""
        self._passed = text

    def accept(self, now_s: float) -> None:
        """Count a message that was of use."""
        self._accepted += 1
        self._passed = ""
        if self._accepted_s is not None:
            self._interval_s = learn_interval_s(self._interval_s, now_s - self._accepted_s, self._silent_after_s)
        self._accepted_s = now_s

    def reject(self, now_s: float, text: str, count: int = 1) -> None:
        """Count a message that was refused, or several, and say why."""
        self._rejected += count
        self._error = _short(text)
        self._error_s = now_s

    def note(self, text: str) -> None:
        """Keep what there is to say without an error, such as "no fix", until it changes; empty for nothing."""
        self._note = text

    def health(self, now_s: float, fault: str = "") -> DeviceHealth:
        """The record; `fault` is what the device reports against itself, empty for nothing."""
        state = self._state(now_s, fault)
        text = _short(fault) if state is DeviceState.FAULTY else self._text(now_s, state)
        return DeviceHealth(now_s, self._role, state, self._accepted, self._rejected, text)

    def _state(self, now_s: float, fault: str) -> DeviceState:
        if not self._line.connected:
            return DeviceState.ABSENT
        if self._accepted_s is None:
            return DeviceState.STARTING
        if now_s - self._accepted_s > timeout_s(self._interval_s, self._silent_after_s):
            return DeviceState.SILENT
        return DeviceState.FAULTY if fault else DeviceState.RUNNING

    def _text(self, now_s: float, state: DeviceState) -> str:
        if state is DeviceState.ABSENT:
            return _short(f"no port {self._line.name}")
        if self._error and now_s - self._error_s <= ERROR_KEPT_S:
            return self._error
        if self._note:
            return _short(self._note)
        talks = self._bytes_s is not None and now_s - self._bytes_s <= SILENT_AFTER_S
        if talks and state is not DeviceState.RUNNING:
            return _short(self._passed) or "bytes, but nothing understood: baud rate?"
        return ""


def _short(text: str) -> str:
    """Bound a text from the outside, and keep to printable ASCII."""
    return "".join(letter if " " <= letter <= "~" else "?" for letter in text[:MAX_TEXT_LENGTH])
