"""Live page of a run: `rambler view` as a separate process, with data through a pipe that never blocks the run."""

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
MIN_SLACK_S = 0.003  # longer than an update takes
STOP_TIMEOUT_S = 3.0
MAX_OUTPUT_BYTES = 4096


class ViewPage:
    """A display that sends the true heading to a page and updates another display; a context that ends the process."""

    def __init__(self, listen: str, state: Path, banner: Banner, world: World, other_display: Display) -> None:
        """Start the page of a state directory and print its address; raise UsageError if that fails."""
        self._world, self._other_display, self._due_s = world, other_display, 0.0
        command = ["view", "--state", str(state), "--listen", listen, "--with-parent", str(os.getpid())]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "firmware_py", *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            bufsize=0,
            start_new_session=True,
        )
        assert self._process.stdin is not None  # noqa: S101 - it is a pipe
        assert self._process.stdout is not None  # noqa: S101 - it is a pipe
        self._input, self._output = self._process.stdin, self._process.stdout
        output = self._output.readline(MAX_OUTPUT_BYTES).decode("utf-8", "replace").strip()
        if not output.startswith("page: "):
            self.close()
            reason = output.removeprefix("rambler view: ").replace("--listen", "--view")
            raise UsageError(reason or f"--view {listen}: the page does not start")
        print(output, flush=True)
        os.set_blocking(self._input.fileno(), False)
        os.set_blocking(self._output.fileno(), False)
        self._send({"title": banner.title})

    def __enter__(self) -> Self:
        """Start the display."""
        self._other_display.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the other display and the page."""
        self._other_display.__exit__(kind, error, trace)
        self.close()

    def update(self, slack_s: float = math.inf) -> None:
        """Send the present state if an update is due and there is time for it."""
        self._other_display.update(slack_s)
        now_s = time.monotonic()
        if now_s < self._due_s or slack_s < MIN_SLACK_S:
            return
        self._due_s = now_s + UPDATE_S
        world = self._world
        heading_deg = round(degrees(world.heading_low_rad()), 3)
        self._send({"time_s": round(world.now_s, 3), "true_heading_deg": heading_deg})
        with contextlib.suppress(OSError):
            os.read(self._output.fileno(), MAX_OUTPUT_BYTES)  # prevents a full pipe, which would block the page

    def close(self) -> None:
        """Close the pipe, which reports the end of the run to the page, and end the process."""
        with contextlib.suppress(OSError):
            self._input.close()
        try:
            self._process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._output.close()

    def _send(self, values: dict[str, float | str]) -> None:
        with contextlib.suppress(OSError):  # pipe full: the page misses an update; pipe closed: the page has ended
            os.write(self._input.fileno(), json.dumps(values).encode() + b"\n")
