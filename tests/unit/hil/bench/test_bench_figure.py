"""Ratios to the bare limit, and when an aim counts as met."""

import pytest

from hil.bench.figure import Figure


@pytest.mark.parametrize(
    ("figure", "met"),
    [
        (Figure("x", "ms", 2.0, most=2.0), True),
        (Figure("x", "ms", 2.1, most=2.0), False),
        (Figure("x", "us", 500.0, 100.0, most_ratio=5.0), True),
        (Figure("x", "us", 501.0, 100.0, most_ratio=5.0), False),
        (Figure("x", "us", 1.0, None, most_ratio=5.0), False),
        (Figure("x", "us", float("nan"), 100.0, most_ratio=5.0), False),
        (Figure("x", "us", float("nan"), most=5.0), False),
        (Figure("x", "us", 1e9, 1.0), None),
        (Figure("x", "times", 15.0, least=15.0), True),
        (Figure("x", "times", 14.9, least=15.0), False),
        (Figure("x", "times", float("nan"), least=15.0), False),
        (Figure("x", "us", 1.0, 1.0, most_ratio=0.5, paired_ratio=0.4), True),
        (Figure("x", "us", 0.1, 1.0, most_ratio=0.5, paired_ratio=0.6), False),
    ],
)
def test_an_aim_is_met_or_not_or_there_is_none(figure, met):
    assert figure.met is met


def test_without_a_bare_limit_there_is_no_ratio():
    assert Figure("x", "ms", 3.0, 2.0).ratio == 1.5
    assert Figure("x", "ms", 3.0).ratio is None
    assert Figure("x", "ms", 3.0, 0.0).ratio is None
