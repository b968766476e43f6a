"""How the first use on a machine goes, which compiles: said on a terminal, silent in a pipe, and kept for later."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hil.bench.figure import Figure, Finding
from hil.bench.objective import hour
from hil.bench.setting import Setting
from hil.errors import HilError
from hil.lab.identify.recording import Recording

ROWS = 3000  # five minutes of log
MOST_SILENCE_S = 2.0
PATIENCE_S = 180.0
COLUMNS = "time_s,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s"


@dataclass(frozen=True, slots=True)
class Use:
    """A use of the command line: how long it took, its longest silence on stderr, and what stood there."""

    seconds: float
    silence_s: float
    said: str


def manoeuvre(path: Path, record: Recording) -> None:
    """Write the first rows of a recording as a manoeuvre file."""
    columns = (record.time_s, record.rudder_rad, record.heading_rad, record.yaw_rate_rad_s)
    rows = zip(*(column[:ROWS].tolist() for column in columns if column is not None), strict=True)
    lines = (",".join(f"{value:.9g}" for value in row) + "," for row in rows)
    path.write_text("\n".join((COLUMNS, *lines)) + "\n", encoding="utf-8")


@contextlib.contextmanager
def stderr_of(*, terminal: bool) -> Iterator[tuple[int, int]]:
    """Open a terminal or a pipe; yields the end to read from and the end to be written to."""
    near, far = pty.openpty() if terminal else os.pipe()
    try:
        yield near, far
    finally:
        os.close(near)
        with contextlib.suppress(OSError):
            os.close(far)


def use(arguments: list[str], cache: Path, *, terminal: bool) -> Use:
    """Run `rambler-hil` with arguments, its machine code kept in a directory; raise HilError when it fails."""
    command = [sys.executable, "-m", "hil", *arguments]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "TERM": "xterm"}
    with stderr_of(terminal=terminal) as (near, far):
        start_s = heard_s = time.monotonic()
        with subprocess.Popen(
            command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=far
        ) as process:
            os.close(far)
            said, silence_s = b"", 0.0
            try:
                while bytes_ := _heard(near, start_s + PATIENCE_S - time.monotonic()):
                    silence_s = max(silence_s, time.monotonic() - heard_s)
                    heard_s = time.monotonic()
                    said += bytes_
                silence_s = max(silence_s, time.monotonic() - heard_s)
            finally:
                if time.monotonic() - start_s >= PATIENCE_S:
                    process.terminate()
        seconds = time.monotonic() - start_s
    text = said.decode(errors="replace")
    if process.returncode != 0:
        raise HilError(f"rambler-hil {arguments[0]} ended with {process.returncode}: {text.strip()[-200:]}")
    return Use(seconds, silence_s, text)


def _heard(descriptor: int, patience_s: float) -> bytes:
    """Return what comes next; nothing at the end, or when patience is over."""
    ready, _, _ = select.select([descriptor], [], [], max(patience_s, 0.0))
    if not ready:
        return b""
    try:
        return os.read(descriptor, 65536)
    except OSError:
        return b""  # a terminal whose other end is closed


def measure(setting: Setting) -> Finding:
    """Identify a short log on a terminal twice, and through a pipe once, in directories without machine code."""
    log = setting.directory / "manoeuvre.csv"
    manoeuvre(log, hour())
    arguments = ["identify", str(log)]
    shown = use(arguments, setting.directory / "first", terminal=True)
    piped = use(arguments, setting.directory / "second", terminal=False)
    again = use(arguments, setting.directory / "first", terminal=True)
    return Finding("First use", figures_of(shown, again, piped), notes_of(piped))


def figures_of(shown: Use, again: Use, piped: Use) -> tuple[Figure, ...]:
    """Return the figures; `bare` of the first use is the second one."""
    return (
        Figure("rambler-hil identify, the first time", "s", shown.seconds, again.seconds),
        Figure("longest silence on the terminal meanwhile", "s", shown.silence_s, most=MOST_SILENCE_S),
        Figure("the first time through a pipe", "s", piped.seconds, again.seconds),
    )


def notes_of(piped: Use) -> tuple[str, ...]:
    """Say how it was measured."""
    said = f"it said {len(piped.said)} characters on stderr" if piped.said else "it said nothing on stderr"
    return (f"a log of {ROWS} rows, from an empty cache of machine code; bare: the second time; in the pipe {said}",)
