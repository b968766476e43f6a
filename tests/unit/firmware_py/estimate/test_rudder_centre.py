"""Mean rudder angle of steady stretches of ten minutes, as the offset of the rudder from the centre."""

import math

import pytest

from firmware_py.common.records import HeadingSample, Inputs, NorthReference, RudderFeedback, Tick
from firmware_py.estimate.rudder_centre import RudderCentre, RudderCentreEstimator


def tick(t_s, heading_deg=40.0, shaft_rad=0.1, source=0):
    headings = (HeadingSample(t_s, math.radians(heading_deg), NorthReference.TRUE, source=source),)
    return Inputs(Tick(0, t_s, 0.0, 0, 1.0), headings, (), (RudderFeedback(t_s, shaft_rad),))


def sail(estimator, start_s, step_s=5.0, heading_deg=lambda _t_s: 40.0, shaft_rad=0.1, source=0, seconds=600.0):
    """Sail a stretch; heading [deg] as a function of the time since its start. The linkage halves the angle."""
    for number in range(math.ceil(seconds / step_s) + 1):
        t_s = number * step_s
        estimator.take(tick(start_s + t_s, heading_deg(t_s), shaft_rad, source), lambda rad: 0.5 * rad, steers=True)


def means(estimator):
    return {sector: values for sector, values in enumerate(estimator.means_rad) if values}


@pytest.mark.parametrize(("heading_deg", "sector"), [(0.0, 0), (44.0, 0), (46.0, 1), (100.0, 2), (359.0, 7)])
def test_mean_angle_of_a_stretch_belongs_to_the_sector_of_its_heading(heading_deg, sector):
    estimator = RudderCentreEstimator()
    sail(estimator, 0.0, heading_deg=lambda _t_s: heading_deg)
    assert means(estimator) == {sector: [pytest.approx(0.05)]}
    assert estimator.result() is None  # two stretches are needed


def test_result_is_the_mean_of_the_sectors():
    estimator = RudderCentreEstimator()
    for number, (heading_deg, shaft_rad) in enumerate(((10.0, 0.1), (20.0, 0.3), (100.0, 0.6))):
        sail(estimator, 1000.0 * number, heading_deg=lambda _t_s, deg=heading_deg: deg, shaft_rad=shaft_rad)
        if number == 1:  # one sector: standard deviation of its stretches
            assert estimator.result() == RudderCentre(pytest.approx(0.1), pytest.approx(0.05 * math.sqrt(2.0)), 2, 1)
    assert estimator.result() == RudderCentre(pytest.approx(0.2), pytest.approx(0.1), 3, 2)


@pytest.mark.parametrize(
    ("options", "stored", "unsteady"),
    [
        pytest.param({"seconds": 595.0}, 0, 0, id="shorter than 600 s"),
        pytest.param({"step_s": 6.1}, 1, 0, id="100 readings"),
        pytest.param({"step_s": 6.2}, 0, 0, id="98 readings"),
        pytest.param({"source": 1}, 0, 0, id="compass B"),
        pytest.param({"shaft_rad": math.nan}, 0, 0, id="no angles"),
        pytest.param({"shaft_rad": None}, 0, 0, id="angles not measured"),
        pytest.param({"heading_deg": lambda _t_s: math.nan}, 0, 0, id="no headings"),
        pytest.param({"heading_deg": lambda t_s: 40.0 + 5.9 * (-1.0) ** (t_s / 5.0)}, 1, 0, id="waves of 5.9 deg"),
        pytest.param({"heading_deg": lambda t_s: 40.0 + 6.1 * (-1.0) ** (t_s / 5.0)}, 0, 1, id="waves of 6.1 deg"),
        pytest.param({"heading_deg": lambda t_s: 350.0 + 0.03 * t_s}, 1, 0, id="turn of 18 deg through north"),
        pytest.param({"heading_deg": lambda t_s: 40.0 - (24.9 if t_s == 300.0 else 0.0)}, 1, 0, id="24.9 deg to port"),
        pytest.param({"heading_deg": lambda t_s: 40.0 - (25.1 if t_s == 300.0 else 0.0)}, 0, 1, id="25.1 deg to port"),
        pytest.param({"heading_deg": lambda t_s: 40.0 + (25.1 if t_s == 600.0 else 0.0)}, 0, 1, id="at the end"),
    ],
)
def test_stretch_is_stored_if_it_is_long_steady_and_measured(options, stored, unsteady):
    estimator = RudderCentreEstimator()
    sail(estimator, 0.0, **options)
    assert (sum(map(len, estimator.means_rad)), estimator.unsteady) == (stored, unsteady)


@pytest.mark.parametrize(
    ("gap_s", "steers", "stored"), [(0.0, True, 1), (10.0, True, 1), (10.1, True, 0), (-0.1, True, 0), (5.0, False, 0)]
)
def test_gap_or_a_tick_without_steering_begins_another_stretch(gap_s, steers, stored):
    estimator = RudderCentreEstimator()
    sail(estimator, 0.0, seconds=500.0)
    estimator.take(tick(500.0 + gap_s), lambda rad: rad, steers=steers)
    sail(estimator, 505.0 + gap_s, seconds=95.0)
    assert sum(map(len, estimator.means_rad)) == stored


def test_stretch_is_not_complete_with_a_tick_without_steering():
    estimator = RudderCentreEstimator()
    sail(estimator, 0.0, seconds=595.0)
    estimator.take(tick(600.0), lambda rad: rad, steers=False)
    assert not means(estimator)


@pytest.mark.parametrize(
    ("sd_deg", "stretches", "sectors", "is_ready"),
    [(0.5, 12, 5, True), (0.51, 12, 5, False), (0.49, 11, 5, False), (0.49, 12, 4, False)],
)
def test_offset_is_proposed_with_12_stretches_5_sectors_and_half_a_degree(sd_deg, stretches, sectors, is_ready):
    assert RudderCentre(0.1, math.radians(sd_deg), stretches, sectors).ready is is_ready
