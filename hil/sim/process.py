"""The autopilot as a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Self

TAIL_BYTES = 4096
TAIL_LINES = 5
SHUT_DOWN = 10  # its exit code when a station has told it to end (docs/reference/command-line.md)
GRACE_S = 4.0  # it brings the rudder amidships and writes out its log


class AutopilotProcess:
    """`rambler run` in the background, its words in a log file; a context that leaves no process behind."""

    def __init__(self, arguments: Sequence[str], log_path: Path) -> None:
        """Start `rambler run` with these arguments, to end with this process however it ends."""
        self._log_path = log_path
        self._log: IO[bytes] = log_path.open("wb")
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "firmware_py", *arguments, "--with-parent", str(os.getpid())],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                # Ctrl-C is for the HIL, which then ends the autopilot in good order.
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
        """End what is still running, in good order if it can."""
        self.terminate()
        if not self.wait(GRACE_S):
            self.kill()
        self._log.close()

    def running(self) -> bool:
        """Whether the process is alive."""
        return self._process.poll() is None

    def exit_code(self) -> int | None:
        """The exit code, or None while it runs."""
        return self._process.poll()

    def terminate(self) -> None:
        """Ask it to end in good order."""
        if self.running():
            self._process.terminate()

    def kill(self) -> None:
        """End it as a power cut does."""
        self._process.kill()
        self._process.wait()

    def wait(self, timeout_s: float) -> bool:
        """Wait for the end; False when it has not come in time."""
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    def last_words(self) -> str:
        """The last lines it wrote, in one line."""
        try:
            with self._log_path.open("rb") as log:
                log.seek(max(0, self._log_path.stat().st_size - TAIL_BYTES))
                text = log.read(TAIL_BYTES).decode("utf-8", "replace")
        except OSError:
            return ""
        return " | ".join(line.strip() for line in text.splitlines()[-TAIL_LINES:] if line.strip())
