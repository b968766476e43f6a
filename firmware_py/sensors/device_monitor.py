"""State, counters and last error of one sensor, for its health record."""

from __future__ import annotations

from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState
from firmware_py.common.sample_timeout import learn_interval_s, timeout_s

SILENT_AFTER_S = 2.0
ERROR_HOLD_S = 10.0  # afterwards, an old error would hide a recovery
MAX_TEXT_LENGTH = 60
NO_HEADING_YET = "connected, no heading yet"


class DeviceMonitor:
    """Determines the state of a device from the reports of its driver: RUNNING for some time after a valid message."""

    def __init__(self, line: ByteLine, role: DeviceRole, silent_after_s: float = SILENT_AFTER_S) -> None:
        """Monitor a device on a line; `silent_after_s` is the minimum timeout (common/sample_timeout.py)."""
        self._silent_after_s = silent_after_s
        self._line = line
        self._role = role
        self._openings = -1
        self._accepted = 0
        self._rejected = 0
        self._last_accepted_s: float | None = None
        self._interval_s = 0.0
        self._last_bytes_s: float | None = None
        self._unused_text = ""
        self._note = ""
        self._last_error = ""
        self._last_error_s = 0.0

    def notice_reopening(self) -> bool:
        """Return whether the line was opened since the last call; if so, reset the state."""
        if self._line.openings == self._openings:
            return False
        self._openings = self._line.openings
        self._last_accepted_s = self._last_bytes_s = None
        self._note = self._last_error = self._unused_text = ""
        return True

    def note_bytes(self, now_s: float) -> None:
        """Record that bytes of any kind have arrived."""
        self._last_bytes_s = now_s

    def note_unused(self, text: str) -> None:
        """Store the text to report while only unused valid messages arrive."""
        self._unused_text = text

    def accept(self, now_s: float) -> None:
        """Count an accepted message."""
        self._accepted += 1
        self._unused_text = ""
        if self._last_accepted_s is not None:
            self._interval_s = learn_interval_s(self._interval_s, now_s - self._last_accepted_s, self._silent_after_s)
        self._last_accepted_s = now_s

    def reject(self, now_s: float, text: str, count: int = 1) -> None:
        """Count rejected messages and store the reason."""
        self._rejected += count
        self._last_error = _printable_ascii(text)
        self._last_error_s = now_s

    def note(self, text: str) -> None:
        """Store a remark that is not an error, such as "no fix", until the next call; empty for none."""
        self._note = text

    def health(self, now_s: float, fault: str = "") -> DeviceHealth:
        """Return the health record; `fault` is a fault reported by the device, empty for none."""
        state = self._determine_state(now_s, fault)
        text = _printable_ascii(fault) if state is DeviceState.FAULTY else self._choose_text(now_s, state)
        return DeviceHealth(now_s, self._role, state, self._accepted, self._rejected, text)

    def _determine_state(self, now_s: float, fault: str) -> DeviceState:
        if not self._line.connected:
            return DeviceState.ABSENT
        if self._last_accepted_s is None:
            return DeviceState.STARTING
        if now_s - self._last_accepted_s > timeout_s(self._interval_s, self._silent_after_s):
            return DeviceState.SILENT
        return DeviceState.FAULTY if fault else DeviceState.RUNNING

    def _choose_text(self, now_s: float, state: DeviceState) -> str:
        if state is DeviceState.ABSENT:
            return _printable_ascii(f"no port {self._line.name}")
        if self._last_error and now_s - self._last_error_s <= ERROR_HOLD_S:
            return self._last_error
        if self._note:
            return _printable_ascii(self._note)
        is_receiving = self._last_bytes_s is not None and now_s - self._last_bytes_s <= SILENT_AFTER_S
        if is_receiving and state is not DeviceState.RUNNING:
            return _printable_ascii(self._unused_text) or "data not understood: wrong baud rate?"
        return ""


def _printable_ascii(text: str) -> str:
    """Truncate an external text and replace all but printable ASCII."""
    return "".join(character if " " <= character <= "~" else "?" for character in text[:MAX_TEXT_LENGTH])
