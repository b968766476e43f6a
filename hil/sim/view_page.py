"""The live page of a run: `rambler view` as a separate process, fed through a pipe that never blocks the run."""

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

LISTEN = "127.0.0.1:8046"  # another port of the same address if this one is in use
UPDATE_S = 0.1
MIN_SLACK_S = 0.003  # in real time: more than an update takes
GRACE_S = 3.0
MAX_OUTPUT_BYTES = 4096


class ViewPage:
    """A display that sends the true heading to a page, beside another display; a context that leaves no process."""

    def __init__(self, listen: str, state: Path, banner: Banner, world: World, other: Display) -> None:
        """Start the page on the state directory of an autopilot and print its address; UsageError when that fails."""
        self._world, self._other, self._due_s = world, other, 0.0
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
        output = self._from.readline(MAX_OUTPUT_BYTES).decode("utf-8", "replace").strip()
        if not output.startswith("page: "):
            self.close()
            words = output.removeprefix("rambler view: ").replace("--listen", "--view")
            raise UsageError(words or f"--view {listen}: the page does not start")
        print(output, flush=True)
        os.set_blocking(self._to.fileno(), False)
        os.set_blocking(self._from.fileno(), False)
        self._send({"title": banner.title})

    def __enter__(self) -> Self:
        """Start the display."""
        self._other.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the other display, and the page."""
        self._other.__exit__(kind, error, trace)
        self.close()

    def update(self, slack_s: float = math.inf) -> None:
        """Send the present state if an update is due and there is time for it."""
        self._other.update(slack_s)
        now_s = time.monotonic()
        if now_s < self._due_s or slack_s < MIN_SLACK_S:
            return
        self._due_s = now_s + UPDATE_S
        world = self._world
        heading_deg = round(degrees(world.heading_low_rad()), 3)
        self._send({"time_s": round(world.now_s, 3), "true_heading_deg": heading_deg})
        with contextlib.suppress(OSError):
            os.read(self._from.fileno(), MAX_OUTPUT_BYTES)  # empties its output pipe, so that the page never blocks

    def close(self) -> None:
        """Report the end of the run to the page's readers, and end the page."""
        with contextlib.suppress(OSError):
            self._to.close()
        try:
            self._process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._from.close()

    def _send(self, values: dict[str, float | str]) -> None:
        with contextlib.suppress(OSError):  # pipe full: the page misses an update; pipe closed: the page has ended
            os.write(self._to.fileno(), json.dumps(values).encode() + b"\n")
