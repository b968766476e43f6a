"""Draws of a campaign: quantiles, limits, errors and random numbers."""

import pytest

from hil.lab.campaign.draws import Draw, DrawError, read_draw, uniform_numbers


def accept_all(_value):
    """Raise no error."""


@pytest.mark.parametrize(
    ("content", "fraction", "value"),
    [
        (3, 0.9, 3.0),
        (True, 0.9, 1.0),
        ("swell", 0.9, "swell"),
        ([1, 2, 4], 0.0, 1.0),
        ([1, 2, 4], 0.34, 2.0),
        ([1, 2, 4], 0.999999, 4.0),
        ({"uniform": [2, 6]}, 0.25, 3.0),
        ({"log_uniform": [1, 100]}, 0.5, 10.0),
        ({"normal": [5, 2, 1, 9]}, 0.5, 5.0),
        ({"normal": [0, 1, 0, 10]}, 0.5, 0.67449),  # the median of the upper half
    ],
)
def test_quantile_of_a_draw(content, fraction, value):
    assert read_draw(content, accept_all).quantile(fraction) == value


@pytest.mark.parametrize("kind", ["uniform", "log_uniform"])
def test_rounded_value_stays_in_the_range(kind):
    low, high = 0.12345678, 0.12345679
    draw = Draw(kind, (low, high))
    assert all(low <= draw.quantile(number / 100) <= high for number in range(100))


def test_normal_draw_far_from_its_mean_stays_within_its_limits():
    draw = read_draw({"normal": [0.0, 1.0, 5.0, 9.0]}, accept_all)
    values = [draw.quantile(number / 1000) for number in range(1000)]
    assert values == sorted(values)
    assert values[0] == 5.0
    assert values[-1] <= 9.0


@pytest.mark.parametrize(
    "content",
    [
        [],
        {},
        None,
        float("nan"),
        [float("inf")],
        [[1]],
        {"uniform": [1]},
        {"uniform": [2, 1]},
        {"uniform": ["a", "b"]},
        {"uniform": 3},
        {"log_uniform": [0, 1]},
        {"normal": [0, 0, -1, 1]},
        {"normal": [0, 1, 1, 1]},
        {"normal": [0, 1, 7, 9]},  # more than 6 sd from the mean
        {"fish": [1, 2]},
        {"uniform": [1, 2], "normal": [0, 1, -1, 1]},
    ],
)
def test_invalid_draws_are_refused(content):
    with pytest.raises(DrawError):
        read_draw(content, accept_all)


def test_both_limits_of_a_distribution_are_checked():
    checked = []
    read_draw({"normal": [5, 2, 1, 9]}, checked.append)
    assert checked == [1.0, 9.0]

    def too_large(value):
        if value > 3:
            raise ValueError("too large")

    with pytest.raises(DrawError, match="too large"):
        read_draw({"uniform": [1, 4]}, too_large)


def test_draws_are_independent_of_the_batch():
    batch = uniform_numbers(7, "ship.K", 0, 50)
    assert [uniform_numbers(7, "ship.K", row, 1)[0] for row in range(50)] == batch
    assert uniform_numbers(7, "ship.K", 13, 20) == batch[13:33]


def test_draws_are_uniform_and_differ_by_name_and_seed():
    values = uniform_numbers(7, "ship.K", 0, 4000)
    assert len(set(values)) == 4000
    assert all(0.0 <= number < 1.0 for number in values)
    assert abs(sum(values) / 4000 - 0.5) < 0.02
    assert not set(values) & set(uniform_numbers(7, "ship.T", 0, 4000))
    assert not set(values) & set(uniform_numbers(8, "ship.K", 0, 4000))
