"""A run of `rambler-hil run` in the background, in real time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from firmware_py.log.disk import log_files
from hil.bench.machine import children_of
from hil.bench.station import Station
from hil.bench.tick import STATE
from hil.errors import HilError

START_TIMEOUT_S = 30.0
END_TIMEOUT_S = 20.0
POLL_S = 1.0
MAX_RUN_S = 600  # limit if the run is not ended


class BackgroundRun:
    """The autopilot in the tank scenario and a UDP ground station; a context that ends both."""

    def __init__(
        self, out: Path, rate_hz: int = 10, links: Sequence[str] = (), *, udp: bool = True, locked: bool = True
    ) -> None:
        """Start, with additional links, and wait for the first heartbeat; raise HilError on a timeout.

        Without `udp` only the radio link of the run is used, not that to the station. With `locked` a tick begins with
        a compass sample that arrives just before its deadline.
        """
        self.station = Station()
        self._udp = udp
        self._logs = out / STATE / "logs"
        out.mkdir(parents=True)
        self._output = out / "hil.log"
        arguments = ["run", "tank", "--speed", "real", "--seconds", str(MAX_RUN_S), "--goal", "0:0"]
        arguments += ["--set", f"LOOP_RATE_HZ={rate_hz}", f"LOOP_LOCK={locked:d}", "--out", str(out)]
        if urls := [*([self.station.url] if udp else []), *links]:
            arguments += ["--link", *urls]
        with self._output.open("wb") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "hil", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                # Ctrl-C is for the bench, which then ends the run in order.
                start_new_session=True,
            )
        try:
            self._await_start()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        """Return the run."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the run."""
        self.close()

    def autopilot(self) -> int:
        """Return the process id of the autopilot; raise HilError if it has ended."""
        children = children_of(self._process.pid)
        if len(children) != 1:
            raise HilError(f"the autopilot has ended: {self._last_output()}")
        return children[0]

    def listen(self, seconds: float) -> None:
        """Receive telemetry for this time without requests."""
        deadline_s = time.monotonic() + seconds
        while (remaining_s := deadline_s - time.monotonic()) > 0.0:
            self.autopilot()
            self.station.listen(min(remaining_s, 2.0))

    def close(self) -> None:
        """End the run in order, so that its log is complete."""
        self._process.terminate()
        try:
            self._process.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            for pid in (*children_of(self._process.pid), self._process.pid):
                os.kill(pid, signal.SIGKILL)
            self._process.wait()
        self.station.close()

    def _await_start(self) -> None:
        deadline_s = time.monotonic() + START_TIMEOUT_S
        while not self._has_started():
            if self._process.poll() is not None or time.monotonic() > deadline_s:
                raise HilError(f"the autopilot did not start: {self._last_output()}")

    def _has_started(self) -> bool:
        """Wait for POLL_S; return True after a heartbeat, or without UDP if there is a log."""
        has_heartbeat = self.station.await_heartbeat(POLL_S) is not None
        return has_heartbeat if self._udp else self._logs.is_dir() and bool(log_files(self._logs))

    def _last_output(self) -> str:
        lines = self._output.read_text(encoding="utf-8", errors="replace").splitlines()
        return lines[-1] if lines else "no output"
