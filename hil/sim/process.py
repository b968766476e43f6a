"""The autopilot as a child process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Self

TAIL_BYTES = 4096
TAIL_LINES = 5
SHUT_DOWN_CODE = 10  # exit code after a shutdown command of a ground station (docs/reference/command-line.md)
POLL_S = 0.02
END_TIMEOUT_S = 4.0  # the autopilot centres the rudder and closes its log


class AutopilotProcess:
    """`rambler run` in the background with its output in a log file; a context that ends the process.

    It does not use Popen.poll and Popen.wait: an interrupt right after they have acquired their lock leaves it
    locked, and the next wait never ends.
    """

    def __init__(self, arguments: Sequence[str], log_path: Path) -> None:
        """Start `rambler run` with these arguments; it also ends if this process is killed."""
        self._log_path = log_path
        self._log: IO[bytes] = log_path.open("wb")
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "firmware_py", *arguments, "--with-parent", str(os.getpid())],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                # Ctrl-C must reach only the harness, which then ends the autopilot in order.
                start_new_session=True,
            )
        except OSError:
            self._log.close()
            raise

    def __enter__(self) -> Self:
        """Return the process."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End a process that still runs, in order if possible."""
        if not self.wait(END_TIMEOUT_S):
            self.kill()
        self._log.close()
        self._process.wait()  # removes the entry of the ended process from the process table

    def running(self) -> bool:
        """Return whether the process has not ended."""
        return self.exit_code() is None

    def exit_code(self) -> int | None:
        """Return the exit code, negative for the signal that ended it, or None while it runs."""
        return self._wait_for_code(os.WNOHANG)

    def terminate(self) -> None:
        """Ask the process to end in order."""
        self._send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End the process like a power cut."""
        self._send_signal(signal.SIGKILL)
        self._wait_for_code()

    def wait(self, timeout_s: float) -> bool:
        """Wait for the end; return False if the timeout expires."""
        deadline_s = time.monotonic() + timeout_s
        while self.running():
            if time.monotonic() > deadline_s:
                return False
            time.sleep(POLL_S)
        return True

    def _wait_for_code(self, options: int = 0) -> int | None:
        """Return the exit code; the entry in the process table stays until the context ends."""
        if (code := self._process.returncode) is not None:
            return code
        ended = os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOWAIT | options)
        if ended is None:
            return None
        return ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status

    def _send_signal(self, number: signal.Signals) -> None:
        if self._process.returncode is None:  # the process id is still valid
            os.kill(self._process.pid, number)

    def last_output(self) -> str:
        """Return the last lines of the output, joined to one line."""
        try:
            with self._log_path.open("rb") as log:
                log.seek(max(0, self._log_path.stat().st_size - TAIL_BYTES))
                text = log.read(TAIL_BYTES).decode("utf-8", "replace")
        except OSError:
            return ""
        return " | ".join(line.strip() for line in text.splitlines()[-TAIL_LINES:] if line.strip())
