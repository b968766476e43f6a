"""A process that only sleeps until absolute deadlines: the smallest lateness on this machine.

`python bare_sleep.py RATE_HZ TICKS BUSY` prints the lateness of each tick in seconds, as a JSON list. It computes for
the fraction BUSY of each period, because a shared machine interrupts a busy process more often.
"""

import json
import sys
import time
from dataclasses import dataclass

from hil.bench.figure import percentile
from hil.bench.machine import autopilot_scheduling


def command(rate_hz, ticks, busy=0.0):
    """Return the command line of the process."""
    return [sys.executable, __file__, str(rate_hz), str(ticks), str(busy)]


def measure_lateness_s(rate_hz, ticks, busy):
    """Sleep from deadline to deadline, after a busy part of each period; return the lateness of each tick."""
    period_s = 1.0 / rate_hz
    late_s = [0.0] * ticks
    deadline_s = time.monotonic()
    for tick in range(ticks):
        busy_until_s = deadline_s + busy * period_s
        while busy and time.monotonic() < busy_until_s:
            pass
        deadline_s += period_s
        time.sleep(max(0.0, deadline_s - time.monotonic()))
        late_s[tick] = max(0.0, time.monotonic() - deadline_s)
    return late_s


@dataclass(frozen=True)
class Spread:
    """Percentiles of samples."""

    count: int
    p50: float
    p99: float
    p999: float
    max: float


def spread(samples):
    """Return the percentiles of samples."""
    return Spread(len(samples), *(percentile(samples, percent) for percent in (50.0, 99.0, 99.9, 100.0)))


if __name__ == "__main__":
    with autopilot_scheduling():
        lateness_s = measure_lateness_s(float(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))
    print(json.dumps(lateness_s))
