"""State, counters and last error of one sensor, for its health record."""

from __future__ import annotations

from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState
from firmware_py.common.sample_timeout import learn_interval_s, timeout_s

SILENT_AFTER_S = 2.0
ERROR_HOLD_S = 10.0  # an old error must not hide a recovery
MAX_TEXT_LENGTH = 60
NO_HEADING_YET = "connected, no heading yet"


class DeviceMonitor:
    """Determines the state of a device from its driver's reports: RUNNING while a valid message is recent."""

    def __init__(self, line: ByteLine, role: DeviceRole, silent_after_s: float = SILENT_AFTER_S) -> None:
        """Monitor a device on a line; a longer sample interval gives a longer timeout (common/sample_timeout.py)."""
        self._silent_after_s = silent_after_s
        self._line = line
        self._role = role
        self._openings = -1
        self._accepted = 0
        self._rejected = 0
        self._accepted_s: float | None = None
        self._interval_s = 0.0
        self._bytes_s: float | None = None
        self._unused_text = ""
        self._note = ""
        self._error = ""
        self._error_s = 0.0

    def notice_reopening(self) -> bool:
        """Return whether the line was opened since the last call; if so, reset the state."""
        if self._line.openings == self._openings:
            return False
        self._openings = self._line.openings
        self._accepted_s = self._bytes_s = None
        self._note = self._error = self._unused_text = ""
        return True

    def note_bytes(self, now_s: float) -> None:
        """Record that bytes of any kind have arrived."""
        self._bytes_s = now_s

    def note_unused(self, text: str) -> None:
        """Store the text to report while only unused valid messages arrive."""
        self._unused_text = text

    def accept(self, now_s: float) -> None:
        """Count an accepted message."""
        self._accepted += 1
        self._unused_text = ""
        if self._accepted_s is not None:
            self._interval_s = learn_interval_s(self._interval_s, now_s - self._accepted_s, self._silent_after_s)
        self._accepted_s = now_s

    def reject(self, now_s: float, text: str, count: int = 1) -> None:
        """Count rejected messages and store the reason."""
        self._rejected += count
        self._error = _short(text)
        self._error_s = now_s

    def note(self, text: str) -> None:
        """Store a remark that is not an error, such as "no fix", until the next call; empty for none."""
        self._note = text

    def health(self, now_s: float, fault: str = "") -> DeviceHealth:
        """Return the health record; `fault` is a fault reported by the device, empty for none."""
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
        if self._error and now_s - self._error_s <= ERROR_HOLD_S:
            return self._error
        if self._note:
            return _short(self._note)
        talks = self._bytes_s is not None and now_s - self._bytes_s <= SILENT_AFTER_S
        if talks and state is not DeviceState.RUNNING:
            return _short(self._unused_text) or "data not understood: wrong baud rate?"
        return ""


def _short(text: str) -> str:
    """Truncate an external text and replace all but printable ASCII."""
    return "".join(letter if " " <= letter <= "~" else "?" for letter in text[:MAX_TEXT_LENGTH])
