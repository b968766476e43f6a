"""Wind over the ground from measurements on the boat; means, gusts and their times."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.records import WindReference, WindSample
from firmware_py.estimate.wind import Motion, WindState, update, velocity_over_ground

AT_REST = Motion(0.0, 0.0, 0.0)


def sample(t_s, wind_m_s, angle_deg, reference=WindReference.NORTH):
    return WindSample(t_s, wind_m_s, math.radians(angle_deg), reference)


def state_after(*samples, motion=AT_REST):
    state = WindState()
    for one in samples:
        state = update(state, (one,), motion)
    return state


def report_after(*samples, motion=AT_REST):
    return state_after(*samples, motion=motion).report


@pytest.mark.parametrize(
    ("reference", "angle_deg", "expected"),
    [
        # Heading east at 2 m/s, drifting north at 1 m/s. Wind from north blows south.
        (WindReference.NORTH, 0.0, (-5.0, 0.0)),
        (WindReference.NORTH, 90.0, (0.0, -5.0)),
        (WindReference.MAGNETIC, 80.0, (0.0, -5.0)),  # declination 10 deg east
        (WindReference.BOW, 0.0, (0.0, -5.0)),
        (WindReference.BOW_WATER, 90.0, (5.0, 0.0)),
        (WindReference.APPARENT, 0.0, (1.0, -3.0)),  # 5 m/s from ahead at 2 m/s are 3 m/s of wind
        (WindReference.APPARENT, 180.0, (1.0, 7.0)),
        (WindReference.APPARENT, 270.0, (-4.0, 2.0)),
    ],
)
def test_velocity_over_ground(reference, angle_deg, expected):
    motion = Motion(math.radians(90.0), 1.0, 2.0, math.radians(10.0))
    assert velocity_over_ground(sample(0.0, 5.0, angle_deg, reference), motion) == pytest.approx(expected, abs=1e-9)


@given(
    st.floats(0.0, 40.0), st.floats(0.0, 360.0), st.floats(0.0, math.tau), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)
)
def test_apparent_wind_of_a_moving_boat_gives_the_wind_over_the_ground(wind_m_s, from_deg, heading_rad, north, east):
    """The apparent wind is computed here from its definition: velocity of the air minus that of the boat."""
    true = (-wind_m_s * math.cos(math.radians(from_deg)), -wind_m_s * math.sin(math.radians(from_deg)))
    relative = (true[0] - north, true[1] - east)
    angle_rad = (math.atan2(-relative[1], -relative[0]) - heading_rad) % math.tau
    measured = WindSample(0.0, math.hypot(*relative), angle_rad, WindReference.APPARENT)
    result = velocity_over_ground(measured, Motion(heading_rad, north, east))
    assert result == pytest.approx(true, abs=1e-9)


def test_without_a_heading_only_a_wind_from_north_is_known():
    lost = Motion(None, 1.0, 2.0)
    assert velocity_over_ground(sample(0.0, 5.0, 0.0, WindReference.NORTH), lost) is not None
    assert velocity_over_ground(sample(0.0, 5.0, 0.0, WindReference.MAGNETIC), lost) is not None
    for reference in (WindReference.APPARENT, WindReference.BOW, WindReference.BOW_WATER):
        assert velocity_over_ground(sample(0.0, 5.0, 0.0, reference), lost) is None


def test_without_a_heading_the_report_has_the_apparent_wind_only():
    report = report_after(sample(3.0, 5.0, 30.0, WindReference.APPARENT), motion=Motion(None, 0.0, 0.0))
    assert (report.t_s, report.apparent_m_s) == (3.0, 5.0)
    assert report.apparent_rad == pytest.approx(math.radians(30.0))
    assert (report.wind_m_s, report.from_rad, report.mean_m_s, report.gust_m_s, report.sd_m_s) == (None,) * 5


def test_wind_from_north_has_no_apparent_wind():
    report = report_after(sample(3.0, 5.0, 30.0))
    assert (report.apparent_m_s, report.apparent_rad) == (None, None)
    assert report.wind_m_s == pytest.approx(5.0)
    assert math.degrees(report.from_rad) == pytest.approx(30.0)


def test_present_wind_is_the_mean_of_ten_seconds_and_the_mean_that_of_two_minutes():
    winds = [4.0] * 110 + [10.0] * 10
    report = report_after(*(sample(float(t_s), wind, 0.0) for t_s, wind in enumerate(winds)))
    assert report.wind_m_s == pytest.approx(10.0)
    assert report.mean_m_s == pytest.approx(4.5)
    assert report.north_m_s == pytest.approx(-10.0)
    assert report.sd_m_s == pytest.approx(math.sqrt(110 / 120 * 0.5**2 + 10 / 120 * 5.5**2))
    one_more = report_after(*(sample(float(t_s), wind, 0.0) for t_s, wind in enumerate([*winds, 10.0])))
    assert one_more.mean_m_s == pytest.approx(4.55)
    eleven = report_after(*(sample(float(t_s), wind, 0.0) for t_s, wind in enumerate([4.0, *[10.0] * 9])))
    assert eleven.wind_m_s == pytest.approx(9.4)


def test_direction_is_that_of_the_mean_vector():
    report = report_after(sample(0.0, 5.0, 350.0), sample(1.0, 5.0, 10.0))
    assert math.cos(report.from_rad) == pytest.approx(1.0)
    assert report.wind_m_s == pytest.approx(5.0)  # the mean of the speeds, not that of the vector
    report = report_after(sample(0.0, 5.0, 90.0), sample(1.0, 5.0, 180.0))
    assert math.degrees(report.from_rad) == pytest.approx(135.0)
    assert math.degrees(report.mean_from_rad) == pytest.approx(135.0)


def test_seconds_have_equal_weight_whatever_the_number_of_their_samples():
    fast = [sample(0.1 * number, 4.0, 0.0) for number in range(10)]
    assert report_after(*fast, sample(1.5, 8.0, 0.0)).wind_m_s == pytest.approx(6.0)
    state = state_after(*fast)
    assert len(state.seconds) == 1
    assert (state.seconds[0].count, state.seconds[0].wind_m_s) == (10, pytest.approx(4.0))


def test_gust_is_the_maximum_of_the_means_over_three_seconds():
    winds = [4.0, 4.0, 10.0, 7.0, 4.0, 4.0, 4.0]
    report = report_after(*(sample(float(t_s), wind, 0.0) for t_s, wind in enumerate(winds)))
    assert report.gust_m_s == pytest.approx(7.0)
    assert report_after(*(sample(float(t_s), 5.0, 0.0) for t_s in range(2))).gust_m_s is None
    assert report_after(*(sample(float(t_s), 5.0, 0.0) for t_s in range(3))).gust_m_s == pytest.approx(5.0)


def test_one_of_three_seconds_may_lack_a_sample_for_a_gust():
    assert report_after(*(sample(t_s, 5.0, 0.0) for t_s in (0.0, 2.0, 3.0))).gust_m_s == pytest.approx(5.0)
    assert report_after(*(sample(t_s, 5.0, 0.0) for t_s in (0.0, 3.0, 6.0))).gust_m_s is None


def test_gust_is_forgotten_after_ten_minutes():
    winds = [12.0 if 20 <= t_s < 30 else 4.0 for t_s in range(661)]
    state, gusts = WindState(), []
    for t_s, wind in enumerate(winds):
        state = update(state, (sample(float(t_s), wind, 0.0),), AT_REST)
        gusts.append(state.report.gust_m_s)
    assert gusts[600] == pytest.approx(12.0)
    assert gusts[601] == pytest.approx(4.0)
    assert len(state.peaks) <= 10


@pytest.mark.parametrize(("after_s", "gust_m_s"), [(600.0, 25.0), (601.0, None)])
def test_first_sample_after_an_outage_does_not_report_an_old_gust(after_s, gust_m_s):
    before = [sample(float(second), 25.0, 0.0) for second in range(10)]
    assert report_after(*before, sample(after_s, 5.0, 0.0)).gust_m_s == gust_m_s


def test_memory_is_limited_and_old_seconds_are_not_used():
    state = WindState()
    for t_s in range(1000):
        state = update(state, (sample(float(t_s), 4.0, 0.0),), AT_REST)
    assert len(state.seconds) == 120
    report = update(state, (sample(5000.0, 9.0, 180.0),), AT_REST).report
    assert (report.wind_m_s, report.mean_m_s) == (pytest.approx(9.0), pytest.approx(9.0))
    assert math.degrees(report.from_rad) == pytest.approx(180.0)


def test_mean_of_two_minutes_ends_with_the_newest_sample_also_without_a_heading():
    winds = [10.0] + [4.0] * 119
    state = state_after(*(sample(float(t_s), wind, 0.0, WindReference.BOW) for t_s, wind in enumerate(winds)))
    assert state.report.mean_m_s == pytest.approx(4.05)
    lost = update(state, (sample(120.0, 9.0, 0.0, WindReference.BOW),), Motion(None, 0.0, 0.0))
    assert lost.report.mean_m_s == pytest.approx(4.0)


def test_report_during_a_loss_of_the_heading_becomes_empty():
    state = state_after(*(sample(float(t_s), 5.0, 0.0, WindReference.BOW) for t_s in range(20)))
    assert state.report.wind_m_s == pytest.approx(5.0)
    lost = update(state, (sample(140.0, 5.0, 0.0, WindReference.BOW),), Motion(None, 0.0, 0.0))
    assert (lost.report.wind_m_s, lost.report.mean_m_s) == (None, None)


def test_calm_has_a_speed_of_zero():
    report = report_after(*(sample(float(t_s), 0.0, 77.0) for t_s in range(5)))
    assert (report.wind_m_s, report.mean_m_s, report.sd_m_s, report.gust_m_s) == (0.0, 0.0, 0.0, 0.0)


def test_velocity_of_a_second_is_the_mean_of_its_samples():
    (second,) = state_after(*(sample(0.2 * n, wind, 60.0) for n, wind in enumerate((4.0, 8.0, 9.0)))).seconds
    assert (second.count, second.wind_m_s) == (3, pytest.approx(7.0))
    assert second.north_m_s == pytest.approx(-7.0 * math.cos(math.radians(60.0)))
    assert second.east_m_s == pytest.approx(-7.0 * math.sin(math.radians(60.0)))
