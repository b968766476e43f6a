from collections import OrderedDict

from hypothesis import given
from hypothesis import strategies as st

from firmware_py.link.latest import keep_latest


@given(st.lists(st.tuples(st.integers(0, 9), st.integers())), st.integers(1, 8))
def test_latest_values_are_stored_up_to_the_maximum(values, max_count):
    table = OrderedDict()
    for key, value in values:
        keep_latest(table, key, value, max_count)
    latest = {}
    for key, value in reversed(values):
        latest.setdefault(key, value)
    assert list(table.items()) == list(latest.items())[:max_count][::-1]
