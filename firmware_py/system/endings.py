"""Endings of earlier runs: collected from the service manager and from the runs, counted and stored.

The state directory may be on a disk that blocks, so these files are in the runtime directory, which is in memory and is
lost when the computer restarts. For each run that ends, the service manager adds a line to ENDED_FILE (ExecStopPost of
the unit). The run itself writes REASON_FILE. When a fatal signal ends the process, Python writes the positions of the
threads to TRACEBACK_FILE.
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
STUCK_EXIT_CODE = 11  # a thread was stuck
SHORT_RUN_S: Final = 60.0
MAX_ENDINGS = 20
_MAX_FILE_BYTES = 1 << 16
_MAX_TEXT_CHARACTERS = 160
_MAX_COUNT = 1_000_000_000
STOPPED, SHUT_DOWN, STUCK, FAILED, WATCHDOG, KILLED, CRASHED, MEMORY, CUT_OFF = (
    "stopped", "shut down", "stuck", "failed", "watchdog", "killed", "crashed", "out of memory", "cut off",
)  # fmt: skip
EXPECTED = (STOPPED, SHUT_DOWN)
_REASONS_BY_EXIT_STATUS: Final[Mapping[str, str]] = {"0": STOPPED, "10": SHUT_DOWN, str(STUCK_EXIT_CODE): STUCK}
# SERVICE_RESULT of systemd.exec(5).
_REASONS_BY_RESULT: Final[Mapping[str, str]] = {
    "watchdog": WATCHDOG, "signal": KILLED, "core-dump": CRASHED, "oom-kill": MEMORY, "timeout": WATCHDOG,
}  # fmt: skip
_CRASH_SIGNALS = ("SEGV", "ABRT", "BUS", "FPE", "ILL", "SYS")
_LOCATION = re.compile(r'File "(?:[^"]*/)?([^"/]+/[^"/]+)", line (\d+) in (\S+)')


class Ending(msgspec.Struct, frozen=True):
    """The end of one run: reason (one of the words above), details, and UTC by the computer's clock."""

    why: str
    text: str = ""
    utc_s: float = 0.0


class Endings(msgspec.Struct, frozen=True):
    """The stored record: number of endings by reason, the last endings (newest last), and whether a run is active.

    `is_young`: the last run was shorter than SHORT_RUN_S. `failed`: it ended by an error of its own. `early` is the
    number of consecutive short runs that failed.
    """

    counts: Mapping[str, int] = msgspec.field(default_factory=dict)
    last: tuple[Ending, ...] = ()
    running: bool = False
    is_young: bool = False
    failed: bool = False
    early: int = 0

    def with_added(self, endings: tuple[Ending, ...]) -> Endings:
        """Return the record with more endings; a power cut does not count as a failure."""
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
    """Decode the endings of this or another version; return them with notes; raises ValueError."""
    endings, notes = record_codec.decode(Endings, content, _VERSION)
    counts = {
        _to_one_line(why): min(max(count, 0), _MAX_COUNT) for why, count in list(endings.counts.items())[:MAX_ENDINGS]
    }
    last, early = tuple(map(_limit_ending, endings.last[-MAX_ENDINGS:])), min(max(endings.early, 0), _MAX_COUNT)
    return replace(endings, counts=counts, last=last, early=early), notes


def _limit_ending(ending: Ending) -> Ending:
    """Return an ending with short one-line texts; a time that is not finite, which JSON cannot contain, becomes 0."""
    utc_s = ending.utc_s if math.isfinite(ending.utc_s) else 0.0
    return Ending(_to_one_line(ending.why), _to_one_line(ending.text), utc_s)


def collect_endings(runtime: Path | None, utc_s: float) -> tuple[Ending, ...]:
    """Return the endings since the last call, oldest first, and remove their files; `utc_s`: the present time."""
    if runtime is None:
        return ()
    lines = _read_and_remove(runtime / ENDED_FILE).splitlines()
    reason = _to_one_line(_read_and_remove(runtime / REASON_FILE))
    location = find_location(_read_and_remove(runtime / TRACEBACK_FILE))
    endings = [parse_ending(line, utc_s) for line in lines if line.strip()]
    if endings and endings[-1].why not in EXPECTED and (reason or location):
        endings[-1] = replace(endings[-1], text=reason or f"{endings[-1].text}{endings[-1].text and ', '}{location}")
    return tuple(endings)


def parse_ending(line: str, now_s: float) -> Ending:
    """Parse a line of the service manager: time, SERVICE_RESULT, EXIT_CODE, EXIT_STATUS; each may be missing."""
    time_text, result, _code, status = (*line.split(), "", "", "", "")[:4]
    utc_s = float(time_text) if time_text.isdecimal() else now_s
    if result == "success" or (result == "exit-code" and status in _REASONS_BY_EXIT_STATUS):
        return Ending(_REASONS_BY_EXIT_STATUS.get(status, STOPPED), "", utc_s)
    if result == "exit-code":
        return Ending(FAILED, f"exit code {status[:20]}", utc_s)
    if result == "signal" and status in _CRASH_SIGNALS:
        return Ending(CRASHED, f"SIG{status}", utc_s)
    text = f"SIG{status[:20]}" if result == "signal" else ""
    return Ending(_REASONS_BY_RESULT.get(result, FAILED), text, utc_s)


def find_location(traceback: str) -> str:
    """Return the position of the failed thread from a traceback of faulthandler; empty if it is unknown."""
    _, _, current = traceback.rpartition("Current thread 0x")  # Python 3.14 adds "Current thread's C stack trace"
    match = _LOCATION.search(current)
    return f"in {match[1]}:{match[2]} {match[3]}" if match else ""


class EndingRecorder:
    """Records in the runtime directory how this run ends; without such a directory it does nothing."""

    def __init__(self, runtime: Path | None) -> None:
        """Enable the traceback of all threads on a fatal signal."""
        self._runtime = runtime
        if runtime is None:
            return
        with contextlib.suppress(OSError):
            self._traceback = (runtime / TRACEBACK_FILE).open("w", encoding="utf-8")
            faulthandler.enable(self._traceback)

    def record_reason(self, text: str) -> None:
        """Write the reason why this run ends; errors are ignored."""
        if self._runtime is None:
            return
        with contextlib.suppress(OSError):
            descriptor = os.open(self._runtime / REASON_FILE, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, FILE_MODE)
            os.write(descriptor, text.encode("utf-8", "replace"))
            os.close(descriptor)


def _read_and_remove(path: Path) -> str:
    try:
        owners = {0, os.geteuid()}
        text = read_regular(path, _MAX_FILE_BYTES, follow_symlinks=False, owners=owners).decode("utf-8", "replace")
    except OSError:
        text = ""
    with contextlib.suppress(OSError):
        path.unlink()
    return text


def _to_one_line(text: str) -> str:
    line = " ".join(text.split())[:_MAX_TEXT_CHARACTERS]
    return line if line.isprintable() else ascii(line)[1:-1][:_MAX_TEXT_CHARACTERS]
