"""The bare limit of punctuality: a process that sleeps to absolute deadlines and does nothing else.

`python -m hil.bench.bare_sleep RATE_HZ TICKS [BUSY]` prints how late each tick was, in seconds, as a JSON list.
With BUSY it computes for that part of each period, from the beginning of it: a machine that is shared takes its
processor more often from one who uses it.
"""

from __future__ import annotations

import json
import sys
import time

from hil.bench.steady import steady


def lateness_s(rate_hz: float, ticks: int, busy: float = 0.0) -> list[float]:
    """Sleep from deadline to deadline, after a busy part of the period, and return how late each sleep ended."""
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


if __name__ == "__main__":
    with steady():
        found_s = lateness_s(float(sys.argv[1]), int(sys.argv[2]), *map(float, sys.argv[3:4]))
    json.dump(found_s, sys.stdout)
