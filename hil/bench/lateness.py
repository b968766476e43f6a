"""How late the ticks of the control loop begin, beside a process that only sleeps."""

from __future__ import annotations

import math

from hil.bench.figure import Figure, Finding
from hil.bench.helper import answer_of
from hil.bench.onboard import logged
from hil.bench.sea import Sea
from hil.bench.setting import Setting
from hil.bench.spread import Spread, spread

MICROSECONDS = 1e6
PARTS = (("p50", "p50"), ("p99", "p99"), ("p99.9", "p999"), ("max", "max"))


def measure(setting: Setting) -> Finding:
    """Run the autopilot in the tank at each rate, with half of the bare sleep before it and half after."""
    figures: list[Figure] = []
    notes = [
        "ticks from the onboard log, start and arming included; bare: as many absolute-deadline sleeps",
        "LOOP_LOCK 0: locked to a compass, a tick begins with its sample and waits for no deadline",
    ]
    for rate_hz, seconds in setting.lateness_s.items():
        half = math.ceil(rate_hz * seconds / 2.0)
        bare_s = _bare(rate_hz, half)
        out = setting.directory / f"lateness-{rate_hz}"
        with Sea(out, rate_hz, locked=False) as sea:
            sea.listen(seconds)
        ticks = [inputs.tick for inputs in logged(out)]
        bare_s += _bare(rate_hz, half)
        figures += figures_of(rate_hz, spread([tick.late_s for tick in ticks]), spread(bare_s))
        notes.append(f"{rate_hz} Hz: {len(ticks)} ticks, {sum(tick.skipped for tick in ticks)} skipped")
    return Finding("Tick lateness", tuple(figures), tuple(notes))


def figures_of(rate_hz: int, ours: Spread, bare: Spread) -> list[Figure]:
    """Return the figures of one rate; the spreads are in seconds."""
    return [
        Figure(f"{rate_hz} Hz, {label}", "us", getattr(ours, part) * MICROSECONDS, getattr(bare, part) * MICROSECONDS)
        for label, part in PARTS
    ]


def _bare(rate_hz: int, ticks: int) -> list[float]:
    found: list[float] = answer_of(["-m", "hil.bench.bare_sleep", str(rate_hz), str(ticks)], ticks / rate_hz)
    return found
