"""Python's instructions are counted, to the last one, whatever else the machine does."""

import sys

from hil.bench.tick import COUNTED_EVERY, WARM_UP_TICKS, counting, instructions


def helper(count):
    return sum(divmod(one, 7)[1] for one in range(count))


def test_count_is_reproducible():
    counts = {instructions(lambda: helper(500)) for _ in range(3)}
    assert len(counts) == 1
    assert {result for _, result in counts} == {helper(500)}


def test_count_is_proportional():
    (few, _), (more, _) = instructions(lambda: helper(2000)), instructions(lambda: helper(3000))
    assert abs(more / few - 1.5) < 0.01


def test_other_trace_function_is_restored():
    def other(*_):
        return None

    before = sys.gettrace()
    sys.settrace(other)
    try:
        instructions(lambda: helper(1))
        found = sys.gettrace()
    finally:
        sys.settrace(before)
    assert found is other


def test_counted_ticks():
    counts, seen = [], []
    step = counting(lambda state, inputs: seen.append(inputs) or helper(state), counts)
    ticks = range(WARM_UP_TICKS + 3 * COUNTED_EVERY)
    assert [step(one, one) for one in ticks] == [helper(one) for one in ticks]
    assert seen == list(ticks)
    assert len(counts) == 3
    assert counts == sorted(set(counts))
