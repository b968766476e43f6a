"""Whether functions of numbers side by side are the library's is looked at before they are taken for them."""

import math

import pytest

from hil.lab import lane_functions, same_bits


@pytest.fixture
def other_library(monkeypatch):
    """A library whose exp now and then differs by a bit, as that of another processor does."""

    def exp(number):
        right = math.exp(number)
        return math.nextafter(right, math.inf) if 0.5 < number < 0.52 else right

    row = same_bits.Row(exp, (same_bits.up_to(lane_functions.exp, lane_functions.EXP_REACH),))
    monkeypatch.setattr(same_bits, "TABLE", (row, *same_bits.TABLE[1:]))
    return exp


def test_a_library_that_differs_by_a_bit_is_asked_itself(other_library):
    assert same_bits.ways_of(other_library) == ()


def test_machine_code_for_one_library_is_not_kept_for_another(request):
    here = same_bits.library()
    request.getfixturevalue("other_library")
    assert same_bits.library() != here


def test_what_has_no_row_is_left_to_the_library():
    assert same_bits.ways_of(math.tan) == ()


def test_what_is_compared_is_what_the_code_computes():
    twice = same_bits.Way(lambda build, numbers: build.fadd(numbers, numbers), -2.0, 1.0)
    assert same_bits._computed(twice) == (2.0 * same_bits.drawn(-2.0, 1.0)).tobytes()
