"""Start, last tick, steps and skipped ticks."""

import pytest

from firmware_py.common.records import Tick
from firmware_py.core.tick_timing import TickTiming, update


@pytest.mark.parametrize(("now_s", "step_s"), [(5.1, 0.1), (6.0, 1.0), (8.0, 1.0), (4.0, 0.0)])
def test_step_is_the_time_since_the_last_tick_up_to_a_second(now_s, step_s):
    assert TickTiming(started_s=0.0, t_s=5.0).step_s(now_s) == pytest.approx(step_s)
    assert TickTiming().step_s(now_s) == 0.0


def test_skipped_ticks_are_counted_with_the_time_of_the_last():
    timing = TickTiming()
    for t_s, skipped, expected in (
        (3.0, 0, TickTiming(3.0, 3.0, 0, None)),
        (4.0, 2, TickTiming(3.0, 4.0, 2, 4.0)),
        (5.0, 0, TickTiming(3.0, 5.0, 2, 4.0)),
        (6.0, 1, TickTiming(3.0, 6.0, 3, 6.0)),
    ):
        timing = update(timing, Tick(0, t_s, 0.0, skipped, 10.0))
        assert timing == expected
