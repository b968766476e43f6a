"""Supervision of a run: watchdogs, the ends of earlier runs, and the end of this one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from msgspec.structs import replace

from firmware_py.common.records import Event, Severity
from firmware_py.common.reports import Output
from firmware_py.loop import LoopParts
from firmware_py.system.endings import (
    CUT_OFF,
    ENDINGS_FILE,
    EXPECTED,
    SHORT_RUN_S,
    Ending,
    EndingRecorder,
    Endings,
    collect_endings,
    from_bytes,
    to_bytes,
)
from firmware_py.system.service_manager import ServiceManager, runtime_directory
from firmware_py.system.store import Store
from firmware_py.system.watchdogs import HardwareWatchdog, WatchdogError, Watchdogs


class Supervision:
    """Connects a run to its watchdogs and records its end."""

    def __init__(
        self,
        parts: LoopParts,
        endings: Endings,
        say: Callable[[str], None],
        environment: Mapping[str, str],
        hardware: Path | None,
        *,
        wait: bool,
    ) -> None:
        """Start the watchdogs, and report the ends of earlier runs.

        `hardware` is the path of the watchdog device. Raises WatchdogError if it cannot be opened, unless `wait`: then
        this is only reported.
        """
        self._store = parts.store
        for event in parts.notices:
            if event.text.startswith(RESTART_PREFIX):
                say(event.text)
        self._save_endings(replace(endings, running=True, is_young=True))
        self._recorder = EndingRecorder(runtime_directory(environment))
        self._next_after_tick, self._stable_s = parts.after_tick, parts.clock.now_s() + SHORT_RUN_S
        parts.after_tick = self._after_tick
        device: HardwareWatchdog | None = None
        try:
            device = HardwareWatchdog(hardware) if hardware is not None else None
            note = device.note if device is not None else ""
        except WatchdogError as error:
            if not wait:
                raise
            note = str(error)
        if note:
            say(note)
            parts.notices.append(Event(Severity.WARNING, note))
        parts.watchdogs = self._watchdogs = Watchdogs(ServiceManager(environment), device)

    def end(self, *, restart: bool) -> None:
        """Record a regular end of the run; `restart`: another one follows in this process."""
        self._watchdogs.stop(restart=restart)
        self._save_endings(replace(self._endings, running=False, is_young=False))

    def end_with_error(self, reason: str) -> None:
        """Record the reason of an unexpected end; then the run is restarted."""
        self._recorder.record_reason(reason)
        self._save_endings(replace(self._endings, failed=True))
        self._watchdogs.stop(restart=True)

    def _after_tick(self, output: Output, now_s: float) -> None:
        if self._endings.is_young and now_s >= self._stable_s:
            self._save_endings(replace(self._endings, is_young=False))
        self._next_after_tick(output, now_s)

    def _save_endings(self, endings: Endings) -> None:
        self._endings = endings
        self._store.save(ENDINGS_FILE, to_bytes(endings))


RESTART_PREFIX = "Started again: "


def read_endings(store: Store, runtime: Path | None, utc_s: float, notices: list[Event]) -> Endings:
    """Return the ends of earlier runs; irregular ends are added to the notices."""
    content = store.load(ENDINGS_FILE)
    endings = Endings()
    try:
        endings, notes = (endings, ()) if content is None else from_bytes(content)
        notices += (Event(Severity.WARNING, f"stored {ENDINGS_FILE}: {note}") for note in notes)
    except ValueError as error:
        notices.append(Event(Severity.WARNING, f"stored {ENDINGS_FILE} ignored: {error}"))
    new = collect_endings(runtime, utc_s)
    if not new and endings.running:
        new = (Ending(CUT_OFF, "", utc_s),)
    endings = replace(endings.with_added(new), running=False)
    if new and (last := new[-1]).why not in EXPECTED:
        times = f"{endings.counts[last.why]} times so far" if endings.counts[last.why] > 1 else "the first time"
        notices.append(Event(Severity.WARNING, f"{RESTART_PREFIX}{last.why}{last.text and f', {last.text}'} ({times})"))
    return endings
