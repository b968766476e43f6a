import re

import numpy as np
import pytest

from hil.report import svg
from hil.report.svg import Interval


def bars(picture):
    """Return the heights of a histogram's bars."""
    return [float(text) for text in re.findall(r'<rect[^>]* height="([\d.]+)"', picture)]


def test_heights_of_a_histogram():
    heights = bars(svg.histogram(np.array([0.0] * 10 + [1.0] * 5)))
    assert len(heights) == svg.BINS
    assert heights[0] == pytest.approx(2.0 * heights[-1])
    assert sum(height > 0.0 for height in heights) == 2


COUNTS = [(10, ["0", "5", "10"]), (7, ["0", "7"]), (12_000, ["0", "6000", "12000"])]


@pytest.mark.parametrize(("most", "counts"), COUNTS)
def test_axis_of_counts(most, counts):
    picture = svg.histogram(np.array([0.0] * most + [1.0] * (most // 2)))
    assert re.findall(r'text-anchor="end">(\d+)</text>', picture)[1:] == counts  # after the largest number
    assert all(float(x) >= svg.COUNT_WIDTH for x in re.findall(r'<rect[^>]* x="([\d.]+)"', picture))


@pytest.mark.parametrize("numbers", [np.full(10, 3.0), np.array([0.1, 0.1 + 1e-16, 0.3 - 0.2])])
def test_equal_numbers(numbers):
    assert sum(height > 0.0 for height in bars(svg.histogram(numbers))) == 1


def test_mark_outside():
    numbers = np.linspace(0.0, 1.0, 100)
    assert svg.histogram(numbers, (0.5, 7.0)).count('class="cursor"') == 1


def test_intervals_that_contain_zero_are_faint():
    picture = svg.intervals([Interval("a<b", 0.5, 0.3, 0.7), Interval("c", 0.1, -0.1, 0.3)])
    assert picture.count("faint") == 2  # line and dot of one
    assert "a&lt;b" in picture
    assert svg.intervals([Interval("zero", 0.0, 0.0, 0.0)]).startswith("<svg")


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (1e-15, "0"), (0.01234, "0.0123"), (-12.345, "-12.3"), (1234.5, "1234"), (2e7, "2e+07")],
)
def test_number_format(value, text):
    assert svg.formatted(value) == text
