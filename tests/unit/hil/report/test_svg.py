import re

import numpy as np
import pytest

from hil.report import svg
from hil.report.svg import Interval


def bars(picture):
    """Return the heights of the bars of a histogram."""
    return [float(text) for text in re.findall(r'<rect[^>]* height="([\d.]+)"', picture)]


def test_bars_have_heights_of_the_counts():
    heights = bars(svg.histogram(np.array([0.0] * 10 + [1.0] * 5)))
    assert len(heights) == svg.BINS
    assert heights[0] == pytest.approx(2.0 * heights[-1])
    assert sum(height > 0.0 for height in heights) == 2


@pytest.mark.parametrize(
    ("maximum", "counts"), [(10, ["0", "5", "10"]), (7, ["0", "7"]), (12_000, ["0", "6000", "12000"])]
)
def test_axis_has_zero_half_and_maximum(maximum, counts):
    picture = svg.histogram(np.array([0.0] * maximum + [1.0] * (maximum // 2)))
    assert re.findall(r'text-anchor="end">(\d+)</text>', picture)[1:] == counts  # after the largest number
    assert all(float(x) >= svg.COUNT_WIDTH for x in re.findall(r'<rect[^>]* x="([\d.]+)"', picture))


@pytest.mark.parametrize("numbers", [np.full(10, 3.0), np.array([0.1, 0.1 + 1e-16, 0.3 - 0.2])])
def test_equal_numbers_give_one_bar(numbers):
    assert sum(height > 0.0 for height in bars(svg.histogram(numbers))) == 1


def test_mark_out_of_range_is_not_drawn():
    numbers = np.linspace(0.0, 1.0, 100)
    assert svg.histogram(numbers, (0.5, 7.0)).count('class="cursor"') == 1


def test_intervals_that_contain_zero_are_faint():
    picture = svg.intervals([Interval("a<b", 0.5, 0.3, 0.7), Interval("c", 0.1, -0.1, 0.3)])
    assert picture.count("faint") == 2  # line and dot of the second
    assert "a&lt;b" in picture
    assert svg.intervals([Interval("zero", 0.0, 0.0, 0.0)]).startswith("<svg")


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (1e-15, "0"), (0.01234, "0.0123"), (-12.345, "-12.3"), (1234.5, "1234"), (2e7, "2e+07")],
)
def test_number_has_three_digits_without_exponent(value, text):
    assert svg.format_number(value) == text
