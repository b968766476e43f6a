"""Python's instructions are counted, to the last one, whatever else the machine does."""

import sys

from hil.bench.tick import EACH, WARM, counting, instructions


def helper(count):
    return sum(divmod(one, 7)[1] for one in range(count))


def test_the_same_work_is_the_same_count_and_comes_to_the_same():
    counts = {instructions(lambda: helper(500)) for _ in range(3)}
    assert len(counts) == 1
    assert {result for _, result in counts} == {helper(500)}


def test_half_as_much_again_is_counted_as_that_inside_of_calls_too():
    (few, _), (more, _) = instructions(lambda: helper(2000)), instructions(lambda: helper(3000))
    assert abs(more / few - 1.5) < 0.01


def test_who_traces_besides_goes_on():
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


def test_one_in_some_of_the_ticks_is_counted_and_all_are_computed():
    counts, seen = [], []
    step = counting(lambda state, inputs: seen.append(inputs) or helper(state), counts)
    assert [step(one, one) for one in range(WARM + 3 * EACH)] == [helper(one) for one in range(WARM + 3 * EACH)]
    assert seen == list(range(WARM + 3 * EACH))
    assert len(counts) == 3
    assert counts == sorted(set(counts))
