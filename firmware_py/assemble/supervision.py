"""A run under watch: who wants to hear that it is alive, how the runs before have ended, and how this one does."""

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
    YOUNG_RUN_S,
    Ending,
    EndingRecorder,
    Endings,
    collect_endings,
    from_bytes,
    to_bytes,
)
from firmware_py.system.hardware_watchdog import HardwareWatchdog, WatchdogError
from firmware_py.system.service_manager import ServiceManager, runtime_directory
from firmware_py.system.store import Store
from firmware_py.system.watchdogs import Watchdogs


class Supervision:
    """Tells the watchdogs of a run, and keeps how it ends."""

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
        """Arm what there is, and report how the runs before have ended.

        WatchdogError for a watchdog device that cannot be had, unless `wait`: then that is told, and she sails without.
        """
        self._store = parts.store
        for event in parts.notices:
            if event.text.startswith(AGAIN):
                say(event.text)
        self._keep(replace(endings, running=True, is_young=True))
        self._watcher = EndingRecorder(runtime_directory(environment))
        self._look_on, self._old_enough_s = parts.show_status, parts.clock.now_s() + YOUNG_RUN_S
        parts.show_status = self._note_tick
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

    def end(self, *, anew: bool) -> None:
        """Say that the run ends as it should; `anew`: another one follows in this process."""
        self._watchdogs.stop(anew=anew)
        self._keep(replace(self._endings, running=False, is_young=False))

    def end_with_error(self, why: str) -> None:
        """Say why the run ends although nobody has asked for it, so that it is started anew."""
        self._watcher.record_reason(why)
        self._keep(replace(self._endings, failed=True))
        self._watchdogs.stop(anew=True)

    def _note_tick(self, output: Output, now_s: float) -> None:
        if self._endings.is_young and now_s >= self._old_enough_s:
            self._keep(replace(self._endings, is_young=False))
        self._look_on(output, now_s)

    def _keep(self, endings: Endings) -> None:
        self._endings = endings
        self._store.save(ENDINGS_FILE, to_bytes(endings))


AGAIN = "Started again: "


def read_endings(store: Store, runtime: Path | None, utc_s: float, notices: list[Event]) -> Endings:
    """Return how the runs before have ended; what was not as it should be is added to the notices."""
    content = store.load(ENDINGS_FILE)
    kept = Endings()
    try:
        kept, notes = (kept, ()) if content is None else from_bytes(content)
        notices += (Event(Severity.WARNING, f"stored {ENDINGS_FILE}: {note}") for note in notes)
    except ValueError as error:
        notices.append(Event(Severity.WARNING, f"stored {ENDINGS_FILE} left out: {error}"))
    found = collect_endings(runtime, utc_s)
    if not found and kept.running:
        found = (Ending(CUT_OFF, "", utc_s),)
    kept = replace(kept.with_added(found), running=False)
    if found and (last := found[-1]).why not in EXPECTED:
        times = f"{kept.counts[last.why]} times so far" if kept.counts[last.why] > 1 else "the first time"
        notices.append(Event(Severity.WARNING, f"{AGAIN}{last.why}{last.text and f', {last.text}'} ({times})"))
    return kept
