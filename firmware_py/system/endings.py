"""How earlier runs have ended: records of the service manager and of the runs themselves, counted and stored.

The state directory may be on a disk that hangs, so these files lie in the runtime directory, which is in memory and is
lost when the computer restarts. For each run that ends, the service manager adds a line to ENDED_FILE (ExecStopPost of
the unit). The run itself writes REASON_FILE. When a signal ends the process, Python writes the threads' positions into
TRACEBACK_FILE.
"""

from __future__ import annotations

import contextlib
import faulthandler
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common import record_codec
from firmware_py.files.reading import read_regular
from firmware_py.files.writing import FILE_MODE

ENDED_FILE, REASON_FILE, TRACEBACK_FILE = "ended", "last-reason", "traceback"
ENDINGS_FILE: Final = "endings.record"
_VERSION: Final = 1
EXIT_STUCK = 11  # exit code: a thread was stuck
YOUNG_RUN_S: Final = 60.0
MAX_ENDINGS = 20
_MAX_FILE_BYTES = 1 << 16
_TEXT_CHARACTERS = 160
_MAX_COUNT = 1_000_000_000
STOPPED, SHUT_DOWN, STUCK_PART, FAILED, WATCHDOG, KILLED, CRASHED, MEMORY, CUT_OFF = (
    "stopped", "shut down", "stuck", "failed", "watchdog", "killed", "crashed", "out of memory", "cut off",
)  # fmt: skip
EXPECTED = (STOPPED, SHUT_DOWN)
_BY_EXIT_STATUS: Final[Mapping[str, str]] = {"0": STOPPED, "10": SHUT_DOWN, str(EXIT_STUCK): STUCK_PART}
# SERVICE_RESULT of systemd.exec(5).
_BY_RESULT: Final[Mapping[str, str]] = {
    "watchdog": WATCHDOG, "signal": KILLED, "core-dump": CRASHED, "oom-kill": MEMORY, "timeout": WATCHDOG,
}  # fmt: skip
_CRASHES = ("SEGV", "ABRT", "BUS", "FPE", "ILL", "SYS")
_LOCATION = re.compile(r'File "(?:[^"]*/)?([^"/]+/[^"/]+)", line (\d+) in (\S+)')


class Ending(msgspec.Struct, frozen=True):
    """The end of one run: reason (a word of the list above), details, and time by the machine's clock."""

    why: str
    text: str = ""
    utc_s: float = 0.0


class Endings(msgspec.Struct, frozen=True):
    """The stored record: number of endings by reason, the last endings (newest last), and whether a run is active.

    `is_young`: the last run was shorter than YOUNG_RUN_S. `failed`: it ended by its own error. `early` is the number of
    consecutive short runs that failed.
    """

    counts: Mapping[str, int] = msgspec.field(default_factory=dict)
    last: tuple[Ending, ...] = ()
    running: bool = False
    is_young: bool = False
    failed: bool = False
    early: int = 0

    def with_added(self, endings: tuple[Ending, ...]) -> Endings:
        """Return the record with more endings. A power cut counts neither as a failure nor as a success."""
        failed = self.failed or any(ending.why not in (*EXPECTED, CUT_OFF) for ending in endings)
        early = self.early + failed if self.is_young else 0
        counts = dict(self.counts)
        for ending in endings:
            counts[ending.why] = counts.get(ending.why, 0) + 1
        return replace(self, counts=counts, last=(*self.last, *endings)[-MAX_ENDINGS:], failed=False, early=early)


def to_bytes(endings: Endings) -> bytes:
    """Encode the endings for storage."""
    return record_codec.encode(endings, _VERSION)


def from_bytes(content: bytes) -> tuple[Endings, tuple[str, ...]]:
    """Decode the endings of this or another version; return them and notes; raises ValueError."""
    endings, notes = record_codec.decode(Endings, content, _VERSION)
    counts = {
        _one_line(why): min(max(count, 0), _MAX_COUNT) for why, count in list(endings.counts.items())[:MAX_ENDINGS]
    }
    last, early = tuple(map(_bounded, endings.last[-MAX_ENDINGS:])), min(max(endings.early, 0), _MAX_COUNT)
    return replace(endings, counts=counts, last=last, early=early), notes


def _bounded(ending: Ending) -> Ending:
    """Return an ending with short one-line texts, and time 0 if it is not finite (not valid in JSON)."""
    utc_s = ending.utc_s if math.isfinite(ending.utc_s) else 0.0
    return Ending(_one_line(ending.why), _one_line(ending.text), utc_s)


def collect_endings(runtime: Path | None, utc_s: float) -> tuple[Ending, ...]:
    """Return the endings of the runs since the last call, oldest first, and remove their files."""
    if runtime is None:
        return ()
    lines = _take(runtime / ENDED_FILE).splitlines()
    reason = _one_line(_take(runtime / REASON_FILE))
    location = location_of(_take(runtime / TRACEBACK_FILE))
    endings = [ending_of(line, utc_s) for line in lines if line.strip()]
    if endings and endings[-1].why not in EXPECTED and (reason or location):
        endings[-1] = replace(endings[-1], text=reason or f"{endings[-1].text}{endings[-1].text and ', '}{location}")
    return tuple(endings)


def ending_of(line: str, now_s: float) -> Ending:
    """Parse a line of the service manager: time, SERVICE_RESULT, EXIT_CODE, EXIT_STATUS; all may be missing."""
    when, result, _code, status = (*line.split(), "", "", "", "")[:4]
    utc_s = float(when) if when.isdecimal() else now_s
    if result == "success" or (result == "exit-code" and status in _BY_EXIT_STATUS):
        return Ending(_BY_EXIT_STATUS.get(status, STOPPED), "", utc_s)
    if result == "exit-code":
        return Ending(FAILED, f"exit code {status[:20]}", utc_s)
    if result == "signal" and status in _CRASHES:
        return Ending(CRASHED, f"SIG{status}", utc_s)
    text = f"SIG{status[:20]}" if result == "signal" else ""
    return Ending(_BY_RESULT.get(result, FAILED), text, utc_s)


def location_of(traceback: str) -> str:
    """Return the position of the loop's thread from a traceback of faulthandler; empty if unknown."""
    _, _, current = traceback.rpartition("Current thread 0x")  # Python 3.14 adds "Current thread's C stack trace"
    match = _LOCATION.search(current)
    return f"in {match[1]}:{match[2]} {match[3]}" if match else ""


class EndingRecorder:
    """Records in the runtime directory how this run ends, if there is one."""

    def __init__(self, runtime: Path | None) -> None:
        """Enable the traceback of all threads on a fatal signal."""
        self._runtime = runtime
        if runtime is None:
            return
        with contextlib.suppress(OSError):
            self._traceback = (runtime / TRACEBACK_FILE).open("w", encoding="utf-8")
            faulthandler.enable(self._traceback)

    def record_reason(self, text: str) -> None:
        """Write the reason of the end of this run."""
        if self._runtime is None:
            return
        with contextlib.suppress(OSError):
            descriptor = os.open(self._runtime / REASON_FILE, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, FILE_MODE)
            os.write(descriptor, text.encode("utf-8", "replace"))
            os.close(descriptor)


def _take(path: Path) -> str:
    try:
        owners = {0, os.geteuid()}
        text = read_regular(path, _MAX_FILE_BYTES, follow=False, owners=owners).decode("utf-8", "replace")
    except OSError:
        text = ""
    with contextlib.suppress(OSError):
        path.unlink()
    return text


def _one_line(text: str) -> str:
    line = " ".join(text.split())[:_TEXT_CHARACTERS]
    return line if line.isprintable() else ascii(line)[1:-1][:_TEXT_CHARACTERS]
