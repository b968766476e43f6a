"""The page of a run under way: `rambler view` as a process of its own, told through a pipe that nobody waits for."""

from __future__ import annotations

import contextlib
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from firmware_py.common.angles import degrees
from hil.errors import UsageError
from hil.sim.display import Banner, Display
from hil.sim.world import World

LISTEN = "127.0.0.1:8046"  # another port of the same address where this one is in use
TELL_S = 0.1
LEAST_SLACK_S = 0.003  # in real time: what telling may take, and much more
GRACE_S = 3.0
MOST_WORDS = 4096


class ViewPage:
    """A display that tells a page what really happens, beside another display; a context that leaves no process."""

    def __init__(self, listen: str, state: Path, banner: Banner, world: World, beside: Display) -> None:
        """Start the page on the autopilot of a state directory and say where it is; UsageError when it cannot be."""
        self._world, self._beside, self._due_s = world, beside, 0.0
        command = ["view", "--state", str(state), "--listen", listen, "--with-parent", str(os.getpid())]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "firmware_py", *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            bufsize=0,
            start_new_session=True,
        )
        assert self._process.stdin is not None  # noqa: S101 - as asked for
        assert self._process.stdout is not None  # noqa: S101 - as asked for
        self._to, self._from = self._process.stdin, self._process.stdout
        said = self._from.readline(MOST_WORDS).decode("utf-8", "replace").strip()
        if not said.startswith("page: "):
            self.close()
            words = said.removeprefix("rambler view: ").replace("--listen", "--view")
            raise UsageError(words or f"--view {listen}: the page does not start")
        print(said, flush=True)
        os.set_blocking(self._to.fileno(), False)
        os.set_blocking(self._from.fileno(), False)
        self._tell({"title": banner.title})

    def __enter__(self) -> Self:
        """Begin to show."""
        self._beside.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the other display, and the page."""
        self._beside.__exit__(kind, error, trace)
        self.close()

    def update(self, slack_s: float = math.inf) -> None:
        """Tell the present state, if it is time to and there is any to spare."""
        self._beside.update(slack_s)
        now_s = time.monotonic()
        if now_s < self._due_s or slack_s < LEAST_SLACK_S:
            return
        self._due_s = now_s + TELL_S
        world = self._world
        heading_deg = round(degrees(world.heading_low_rad()), 3)
        self._tell({"time_s": round(world.now_s, 3), "true_heading_deg": heading_deg})
        with contextlib.suppress(OSError):
            os.read(self._from.fileno(), MOST_WORDS)  # whatever it says, it shall not have to wait

    def close(self) -> None:
        """Have the page tell its readers that it is over, and end it."""
        with contextlib.suppress(OSError):
            self._to.close()
        try:
            self._process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._from.close()

    def _tell(self, words: dict[str, float | str]) -> None:
        with contextlib.suppress(OSError):  # full: it misses a line; gone: there is no page any more
            os.write(self._to.fileno(), json.dumps(words).encode() + b"\n")
