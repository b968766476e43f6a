"""The bare limit of punctuality: a process that sleeps to absolute deadlines and does nothing else.

`python -m hil.bench.bare_sleep RATE_HZ TICKS` prints how late each tick was, in seconds, as a JSON list.
"""

from __future__ import annotations

import json
import sys
import time

from hil.bench.steady import steady


def lateness_s(rate_hz: float, ticks: int) -> list[float]:
    """Sleep from deadline to deadline and return how late each sleep ended."""
    period_s = 1.0 / rate_hz
    late_s = [0.0] * ticks
    deadline_s = time.monotonic()
    for tick in range(ticks):
        deadline_s += period_s
        time.sleep(max(0.0, deadline_s - time.monotonic()))
        late_s[tick] = max(0.0, time.monotonic() - deadline_s)
    return late_s


if __name__ == "__main__":
    with steady():
        found_s = lateness_s(float(sys.argv[1]), int(sys.argv[2]))
    json.dump(found_s, sys.stdout)
