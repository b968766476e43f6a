"""Logs of a state directory: recorder, file access of ground stations, and time of the newest log."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from firmware_py import version_text
from firmware_py.common.interfaces import Clock, Position
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.link.files.tree import FileRoot
from firmware_py.log.disk import LocalDisk, log_files, newest_log_time_s
from firmware_py.log.recorder import LogRecorder
from firmware_py.sensors.receiver_time import TimeCorrectedPosition
from firmware_py.system.clock import LockstepClock
from firmware_py.system.state_directory import LOG_DIRECTORY, UPLOAD_DIRECTORY


def file_root(directory: Path, parameters: ParameterSet) -> FileRoot:
    """Return the files that ground stations can access: logs, and a directory for uploads."""
    logs = directory / LOG_DIRECTORY
    return FileRoot(
        lambda: log_files(logs) if logs.is_dir() else {},
        logs,
        directory / UPLOAD_DIRECTORY,
        logging=bool(parameters["LOG_ENABLE"]),
        background=True,
    )


def log_recorder(
    directory: Path, parameters: ParameterSet, plans: Plans, clock: Clock, commit: str, opened: ExitStack
) -> LogRecorder | None:
    """Return the log recorder of a state directory, closed by `opened`; None if logging is disabled.

    In lockstep it waits for the disk, which takes no simulated time.
    """
    if not parameters["LOG_ENABLE"]:
        return None
    file_bytes, min_free_bytes = int(parameters["LOG_FILE_MB"] * 1e6), int(parameters["LOG_FREE_MB"] * 1e6)
    recorder = LogRecorder(
        directory / LOG_DIRECTORY,
        parameters=parameters,
        plans=plans,
        file_bytes=file_bytes,
        max_total_bytes=int(parameters["LOG_KEEP_MB"] * 1e6),
        min_free_bytes=min_free_bytes,
        utc_s=clock.utc_s(),
        software=version_text("rambler", commit),
        wait_for_disk=isinstance(clock, LockstepClock),
        disk=LocalDisk(retention_days=parameters["LOG_KEEP_DAYS"], reserve_bytes=min_free_bytes + file_bytes),
        clock_utc_s=clock.utc_s,
    )
    opened.callback(recorder.close)
    return recorder


def with_corrected_times(
    position: Position | None, clock: Clock, directory: Path, say: Callable[[str], None]
) -> Position | None:
    """Return a receiver whose times are corrected by clock and logs; None without a receiver."""
    if position is None:
        return None
    return TimeCorrectedPosition(position, clock.utc_s, newest_log_time_s(directory / LOG_DIRECTORY), say)
