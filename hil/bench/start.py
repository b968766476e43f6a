"""How long from starting the autopilot to its first rudder frame, beside a Python that does nothing."""

from __future__ import annotations

import subprocess
import sys
import time

from hil.bench.figure import Figure, Finding
from hil.bench.rig import Rig
from hil.bench.setting import Setting
from hil.bench.spread import percentile

PATIENCE_S = 20.0
MOST_S = 0.5
BARE = (sys.executable, "-c", "pass")


def measure(setting: Setting) -> Finding:
    """Start the autopilot several times, a Python that does nothing in between."""
    frames_s, heartbeats_s, bare_s = [], [], []
    for index in range(setting.starts):
        with Rig(setting.directory / f"start-{index}") as rig:
            frame_s, heartbeat_s = rig.serve_until_alive(PATIENCE_S)
        frames_s.append(frame_s)
        heartbeats_s.append(heartbeat_s)
        bare_s.append(_bare())
    notes = (
        f"median of {setting.starts} starts, counted from just before fork and exec",
        "the servo is found and configured before its first goal, at 57600 baud",
        "bare: python -c pass, from start to end",
    )
    return Finding("Start", figures_of(frames_s, heartbeats_s, bare_s), notes)


def figures_of(frames_s: list[float], heartbeats_s: list[float], bare_s: list[float]) -> tuple[Figure, ...]:
    """Return the medians as figures."""
    bare = _median(bare_s)
    return (
        Figure("first rudder frame", "s", _median(frames_s), bare, most=MOST_S),
        Figure("first heartbeat on UDP", "s", _median(heartbeats_s), bare, peer="ArduRover 1.0"),
    )


def _bare() -> float:
    start_s = time.monotonic()
    subprocess.run(BARE, check=True)
    return time.monotonic() - start_s


def _median(samples: list[float]) -> float:
    return percentile(sorted(samples), 50.0)
