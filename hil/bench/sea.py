"""A run of `rambler-hil run` in the background: the autopilot under way in real time, as anybody would start it."""

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

START_S = 30.0
END_S = 20.0
LOOK_S = 1.0
LONGEST_RUN_S = 600  # should nobody end it


class Sea:
    """The tank, an autopilot in it and a UDP ground station; a context that ends all three."""

    def __init__(
        self, out: Path, rate_hz: int = 10, links: Sequence[str] = (), *, udp: bool = True, locked: bool = True
    ) -> None:
        """Start, with more links if wanted, and wait for the autopilot's first words; HilError when none come.

        Without `udp` there is no link to the station, only the run's own, a radio. Ticks that are `locked` begin with
        the compass where it comes just before their deadline; others wait for that.
        """
        self.station = Station()
        self._udp = udp
        self._logs = out / STATE / "logs"
        out.mkdir(parents=True)
        self._words = out / "hil.log"
        arguments = ["run", "tank", "--speed", "real", "--seconds", str(LONGEST_RUN_S), "--goal", "0:0"]
        arguments += ["--set", f"LOOP_RATE_HZ={rate_hz}", f"LOOP_LOCK={locked:d}", "--out", str(out)]
        if urls := [*([self.station.url] if udp else []), *links]:
            arguments += ["--link", *urls]
        with self._words.open("wb") as words:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "hil", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=words,
                stderr=words,
                # Ctrl-C is for the bench, which then ends the run in good order.
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
        """Return the number of the autopilot's process; HilError when it has gone."""
        children = children_of(self._process.pid)
        if len(children) != 1:
            raise HilError(f"the autopilot has ended: {self._last_words()}")
        return children[0]

    def listen(self, seconds: float) -> None:
        """Let time go by, as a ground station that only looks on."""
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0.0:
            self.autopilot()
            self.station.listen(min(left_s, 2.0))

    def close(self) -> None:
        """End the run in good order, so that its log is whole."""
        self._process.terminate()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            for pid in (*children_of(self._process.pid), self._process.pid):
                os.kill(pid, signal.SIGKILL)
            self._process.wait()
        self.station.close()

    def _await_start(self) -> None:
        end_s = time.monotonic() + START_S
        while not self._started():
            if self._process.poll() is not None or time.monotonic() > end_s:
                raise HilError(f"the autopilot did not start: {self._last_words()}")

    def _started(self) -> bool:
        """Wait a moment; return whether it has been heard by then, or else seen to write its log."""
        heard = self.station.await_heartbeat(LOOK_S) is not None
        return heard if self._udp else self._logs.is_dir() and bool(log_files(self._logs))

    def _last_words(self) -> str:
        lines = self._words.read_text(encoding="utf-8", errors="replace").splitlines()
        return lines[-1] if lines else "it said nothing"
