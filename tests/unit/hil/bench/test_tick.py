"""Counting of Python instructions."""

import sys

from hil.bench.tick import TICKS_PER_COUNT, WARM_UP_TICKS, counting, instructions


def helper(count):
    return sum(divmod(number, 7)[1] for number in range(count))


def test_count_is_reproducible():
    counts = {instructions(lambda: helper(500)) for _ in range(3)}
    assert len(counts) == 1
    assert {result for _, result in counts} == {helper(500)}


def test_count_is_proportional():
    (short, _), (long, _) = instructions(lambda: helper(2000)), instructions(lambda: helper(3000))
    assert abs(long / short - 1.5) < 0.01


def test_other_trace_function_is_restored():
    def other(*_):
        return None

    previous = sys.gettrace()
    sys.settrace(other)
    try:
        instructions(lambda: helper(1))
        restored = sys.gettrace()
    finally:
        sys.settrace(previous)
    assert restored is other


def test_some_ticks_are_counted_without_changing_results():
    counts, inputs_of_ticks = [], []
    step = counting(lambda state, inputs: inputs_of_ticks.append(inputs) or helper(state), counts)
    ticks = range(WARM_UP_TICKS + 3 * TICKS_PER_COUNT)
    assert [step(tick, tick) for tick in ticks] == [helper(tick) for tick in ticks]
    assert inputs_of_ticks == list(ticks)
    assert len(counts) == 3
    assert counts == sorted(set(counts))
