"""The onboard log as the loop sees it: ticks are encoded, a few at a time, and queued without waiting."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Final

from firmware_py.common.intents import ReplacePlan, SetParameter
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanKind, Plans
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, Inputs, Progress, Severity, Tick
from firmware_py.common.reports import Output
from firmware_py.faults.table import TABLE
from firmware_py.log import ardupilot, schema
from firmware_py.log.archive_worker import ArchiveWorker
from firmware_py.log.ardupilot_plans import encode_plan
from firmware_py.log.ardupilot_state import ArduPilotState, encode_version
from firmware_py.log.dataflash import header
from firmware_py.log.disk import Disk, LocalDisk
from firmware_py.log.message_rows import microseconds
from firmware_py.log.thin import HEAD, ThinLog
from firmware_py.log.thin_file import ThinFile
from firmware_py.log.writer import LogWriter

FLUSH_S: Final = 1.0
# Ticks without events are encoded a few at a time, which is faster because the code is not in the caches after a tick.
MAX_HELD_TICKS, MAX_HELD_S = 5, 0.5
NO_PLANS: Final = Plans()
_SEVERE_FAULTS: Final = sum(
    1 << fault for fault, row in TABLE.items() if row.severity <= Severity.ERROR
)  # request a black box


class LogRecorder:
    """Recorder of numbered DataFlash files in a directory.

    A tick is dropped and counted if the queue is full or its values do not fit the format. The next tick that is
    written contains a checkpoint.
    """

    def __init__(
        self,
        directory: Path,
        *,
        parameters: ParameterSet,
        plans: Plans = NO_PLANS,
        file_bytes: int,
        max_total_bytes: int,
        min_free_bytes: int = 0,
        utc_s: float,
        software: str,
        queue_batches: int = 2048,
        queue_bytes: int = 4 << 20,
        background: bool = True,
        wait_for_disk: bool = False,
        disk: Disk | None = None,
        clock_utc_s: Callable[[], float] | None = None,
    ) -> None:
        """Start the recorder; the first file is created with the first tick. Raises no error.

        A new file starts after `file_bytes`. Beyond `max_total_bytes` the oldest file is removed; with less than
        `min_free_bytes` free, no file is created. `utc_s` is the time of the start. Without `background`, the caller's
        thread writes whenever the queue is half full: no tick is dropped, but the caller waits for the disk. With
        `wait_for_disk` the caller waits until the first tick is on disk, and whenever the queue is full. With
        `clock_utc_s`, a thin log is written and closed logs are archived.
        """
        self._file_bytes = min(file_bytes, max_total_bytes // 2)
        self._parameters = parameters
        self._plans = plans
        self._software = software
        self._ardupilot_state = ArduPilotState()
        self._start_texts = ardupilot.start_texts(software, utc_s)
        self._sequence = 0  # number of the next tick; dropped ticks are counted, too
        self._dropped_ticks = 0
        self._drop_reason = ""  # reason why the last tick was dropped, empty if it was not
        self._opened_files = self._file_size = 0  # `requested_files` at the start of the last file; its bytes
        self._held_ticks: list[tuple[Inputs, Output, Callable[[], str]]] = []  # ticks that are not encoded yet
        self._mode: int | None = None
        self._severe_faults = 0  # severe faults of the last tick
        self._archive_worker = ArchiveWorker(directory)
        self._thin_file = ThinFile(directory, HEAD)
        self._thin = None if clock_utc_s is None else ThinLog(clock_utc_s, self._start_texts)
        self.writer = LogWriter(
            directory,
            disk if disk is not None else LocalDisk(),
            max_log_bytes=max_total_bytes - self._file_bytes,
            queue_batches=queue_batches,
            queue_bytes=queue_bytes,
            flush_s=FLUSH_S,
            min_free_bytes=min_free_bytes,
            wait_for_disk=wait_for_disk,
            turn=self._do_background_work,
            finish=self._finish_thin_log,
        )
        if background:
            self.writer.start()

    def offer(self, inputs: Inputs, output: Output, previous_state: Callable[[], str]) -> None:
        """Queue a tick without blocking, or drop and count it; a tick without events and requests may be held."""
        self._update_thin_log(inputs, output)
        self._held_ticks.append((inputs, output, previous_state))
        if (
            output.events
            or inputs.requests
            or len(self._held_ticks) >= min(MAX_HELD_TICKS, MAX_HELD_S * inputs.tick.rate_hz)
        ):
            self._queue_held_ticks()

    def _queue_held_ticks(self) -> None:
        held_ticks, self._held_ticks = self._held_ticks, []
        for inputs, output, previous_state in held_ticks:
            self._queue_tick(inputs, output, previous_state)

    def _queue_tick(self, inputs: Inputs, output: Output, previous_state: Callable[[], str]) -> None:
        """Queue a tick, or drop and count it."""
        sequence = self._sequence
        self._sequence += 1
        changed = self._apply_settings(inputs)
        if self.writer.is_full():
            self._drop("log: disk too slow, tick dropped")
            return
        requested = self.writer.requested_files
        opens_file = requested != self._opened_files or self._file_size >= self._file_bytes
        try:
            state = previous_state() if opens_file or self._drop_reason else None
            body = self._encode_tick(inputs, output, state, opens_file=opens_file) + changed
            data = schema.append_end(body, inputs.tick.t_s, sequence)
            if opens_file:
                data = self._encode_file_header(inputs.tick) + data
        except (struct.error, ValueError, TypeError, OverflowError) as error:  # data that a driver should have rejected
            self._drop(f"log: a tick cannot be written: {error}"[:100])
            return
        self._drop_reason = ""
        self._mode = output.snapshot.mode
        self._opened_files = requested
        self._file_size = len(data) if opens_file else self._file_size + len(data)
        self.writer.put(data, opens_file=opens_file)

    def health(self, now_s: float) -> DeviceHealth:
        """Return the health of the log; `rejected` is the number of ticks dropped or lost."""
        lost = self._dropped_ticks + self.writer.lost
        text = self._drop_reason or self.writer.failure or self._thin_file.failure or self._archive_worker.failure
        if not self.writer.is_alive():
            text = text or "log: the writer has ended"
        state = DeviceState.RUNNING if self.writer.has_written else DeviceState.STARTING
        if self.writer.low_space:
            state, text = DeviceState.FULL, text or "log: the disk is nearly full"
        elif text:
            state = DeviceState.FAULTY
        return DeviceHealth(now_s, DeviceRole.STORAGE, state, self._sequence - lost, lost, text)

    def progress(self) -> tuple[Progress, ...]:
        """Return the progress of the writer's thread; empty without one."""
        return self.writer.progress()

    def close(self) -> None:
        """Write all held and queued ticks, and close the file."""
        self._queue_held_ticks()
        self.writer.close()

    def _update_thin_log(self, inputs: Inputs, output: Output) -> None:
        """Add the tick to the thin log, and request a black box for a new severe fault."""
        severe_faults = output.snapshot.faults & _SEVERE_FAULTS
        self._archive_worker.note_tick(inputs.tick.t_s, is_severe=bool(severe_faults & ~self._severe_faults))
        self._severe_faults = severe_faults
        if self._thin is None:
            return
        try:
            rows = self._thin.update(inputs, output)
        except (struct.error, ValueError, TypeError, OverflowError):  # the full log reports such a tick
            return
        if rows:
            self._thin_file.put(rows)

    def _do_background_work(self, written_bytes: int) -> None:
        """Write the thin log and do steps of archiving; called on the writer's thread."""
        if self._thin is not None:
            self._thin_file.drain()
            self._archive_worker.work(written_bytes)

    def _finish_thin_log(self) -> None:
        self._thin_file.drain()
        self._thin_file.close()

    def _drop(self, reason: str) -> None:
        self._dropped_ticks += 1
        self._drop_reason = reason

    def _encode_plans(self, t_s: float, *plans: Plan) -> bytes:
        identity = int(self._parameters["LNK_IDENTITY"])
        return b"".join(encode_plan(t_s, plan, identity) for plan in plans)

    def _apply_settings(self, inputs: Inputs) -> bytes:
        """Update the parameters and plans from the requests of a tick, and return the messages of the changes."""
        changed = b""
        for request in inputs.requests:
            if isinstance(request.intent, SetParameter):
                name = request.intent.name
                with contextlib.suppress(ParameterError):
                    self._parameters = self._parameters.replaced(name, request.intent.value)
                    changed += ardupilot.encode_parameter(inputs.tick.t_s, name, self._parameters[name])
            elif isinstance(request.intent, ReplacePlan):
                self._plans = self._plans.replaced(request.intent.plan)
                changed += self._encode_plans(inputs.tick.t_s, request.intent.plan)
        return changed

    def _encode_file_header(self, tick: Tick) -> bytes:
        return b"".join(
            (
                header((*schema.TYPES, *ardupilot.TYPES), microseconds(tick.t_s)),
                ardupilot.encode_parameters(tick.t_s, self._parameters),
                ardupilot.encode_texts(tick.t_s, self._start_texts),
                encode_version(tick.t_s, self._software),
                self._encode_plans(tick.t_s, *(self._plans.of(kind) for kind in PlanKind)),
            )
        )

    def _encode_tick(self, inputs: Inputs, output: Output, state: str | None, *, opens_file: bool) -> bytes:
        tick = inputs.tick
        t_s = tick.t_s
        parts = [schema.TICK.pack(t_s, tick)]
        if state is not None:
            parts.append(schema.CHECKPOINT.pack_text(t_s, tick, state))
        if self._drop_reason:
            parts.append(schema.DROP.pack(microseconds(t_s), self._dropped_ticks))
        parts.append(schema.encode_inputs(inputs))
        parts.append(schema.encode_output(output))
        parts += [ardupilot.encode_position(sample) for sample in inputs.positions]
        if opens_file or output.snapshot.mode != self._mode:
            parts.append(ardupilot.encode_mode(t_s, output.snapshot.mode))
        log_all = opens_file or bool(self._drop_reason)
        parts.append(
            self._ardupilot_state.encode_tick(
                inputs, output, self._parameters, dropped=self._dropped_ticks, log_all=log_all
            )
        )
        if output.events:
            parts.append(ardupilot.encode_texts(t_s, output.events))
        return b"".join(parts)
