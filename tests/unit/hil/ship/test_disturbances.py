"""Options of `--with`: parsing, errors, listing, and their effect on the hull."""

import math
from dataclasses import fields

import numpy as np
import pytest

from firmware_py.common.angles import degrees, radians
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.ship.disturbance_options import TABLE, DisturbanceError, describe_options, description_rows, parse, text_of
from hil.ship.disturbances import NO_DISTURBANCES, Disturbances, FloatBody, Leeway, OtherShip, Slide
from hil.ship.hull import STEPS_PER_SECOND, Hull
from hil.ship.scenarios import TABLE as SCENARIOS
from hil.ship.scenarios import find_scenario, parse_scenario, with_disturbances
from hil.ship.wave_speed import MAX_SPEED_RATIO

ALL_OPTIONS = (
    "float,leeway,sway,orbital,speed,receiver,compass,kt=2,delay=2,supply,vessels=head-on:0.3,yaw,waves,bias"
    ",wind=9:200,depth"
)


def test_text_of_parsed_options_gives_the_same_options():
    parsed = parse("float=0.3:0.7, leeway=8,sway")
    assert parsed == Disturbances(float_body=FloatBody(0.3, 0.7), leeway=Leeway(8.0), slide=Slide(1.0))
    assert text_of(parsed) == "float=0.3:0.7,leeway=8:0:0,sway=1"
    assert text_of(parse("vessels=flood")) == "vessels=flood:0.1:40"
    assert parse("kt=3").other_ship == OtherShip(3.0, 1.0)
    scenarios = [text_of(row.disturbances) for row in SCENARIOS if row.disturbances != NO_DISTURBANCES]
    for text in (ALL_OPTIONS, "float=0.123456789", *scenarios):
        assert parse(text_of(parse(text))) == parse(text)
    assert text_of(NO_DISTURBANCES) == ""


def test_option_replaces_that_of_the_scenario():
    disturbances = with_disturbances(find_scenario("ocean-1"), "leeway=0").disturbances
    assert disturbances.leeway == Leeway(0.0)
    assert disturbances.float_body == find_scenario("ocean-1").disturbances.float_body
    assert parse_scenario("swell+sway").disturbances == Disturbances(slide=Slide())


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "unknown option ''"),
        ("raft", "use one of float, leeway"),
        ("float=", "own frequency '' must be"),
        ("float=0.3:0.6:1", r"3 numbers are too many; write float\[=OWN"),
        ("float=nan", "must be 0.05 to 3 rad/s"),
        ("float=inf", "must be 0.05 to 3 rad/s"),
        ("float=-1", "must be"),
        ("leeway=46", "must be -45 to 45 deg"),
        ("leeway=1e999", "must be"),
        ("receiver=0.5:1.01", "must be 0 to 1"),
        ("kt", "ability is missing; write kt=ABILITY"),
        ("delay", "delay is missing"),
        ("vessels=regatta", "unknown scene 'regatta'; use one of crossing, head-on, overtaking"),
        ("vessels=flood:2", "lost '2' must be 0 to 1 share"),
        ("sway,sway", "twice"),
        ("sway,", "unknown option ''"),
        ("=", "unknown option ''"),
        ("sway=\x00", "must be"),
        ("x" * 600, "600 characters"),
    ],
)
def test_invalid_option_raises_an_error_of_one_line(text, error):
    with pytest.raises(DisturbanceError, match=error) as caught:
        parse(text)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("text", "error"), [("calm+orbital", "calm has no waves"), ("calm+waves", "calm has no wave yaw")]
)
def test_option_for_waves_needs_a_scenario_with_waves(text, error):
    with pytest.raises(DisturbanceError, match=error):
        parse_scenario(text)


def test_table_contains_all_disturbances_with_valid_defaults():
    assert [row.field for row in TABLE] == [field.name for field in fields(Disturbances)]
    text = describe_options()
    for row in TABLE:
        assert row.text in text
        assert row.source in text
        for number in fields(row.record):
            if "choices" in number.metadata:
                assert number.default in number.metadata["choices"]
                continue
            low, high = number.metadata["low"], number.metadata["high"]
            assert low < high
            assert not isinstance(number.default, float) or low <= number.default <= high
    assert [name.split(":")[0] for name, _ in description_rows(parse(ALL_OPTIONS))] == [row.name for row in TABLE]


def simulate(text, seconds, rudder_deg=0.0, seed=1):
    """Run a scenario with a constant rudder; return the hull, and heading and velocity over ground each second."""
    hull = Hull(parse_scenario(text), OCEAN_RAMBLER, seed)
    rows = []
    for _ in range(round(seconds)):
        for _ in range(STEPS_PER_SECOND):
            hull.step(radians(rudder_deg))
        rows.append((hull.heading_low_rad(0.0), *hull.velocity_m_s(0.0)))
    return hull, np.array(rows)


@pytest.mark.parametrize("body_deg", [8.0, -3.0])
def test_leeway_is_to_starboard_of_the_heading(body_deg):
    hull, rows = simulate(f"calm+leeway={body_deg}", 100.0, rudder_deg=10.0)
    course_rad = np.arctan2(rows[:, 2], rows[:, 1])
    leeway_deg = np.degrees(np.angle(np.exp(1j * (course_rad - rows[:, 0]))))
    assert leeway_deg == pytest.approx(body_deg)
    # The velocity along the heading is unchanged.
    assert np.hypot(rows[:, 1], rows[:, 2]) == pytest.approx(0.4 / math.cos(radians(body_deg)))
    assert hull.speed_m_s == 0.4


def test_leeway_from_wind_is_largest_on_the_beam():
    for wind_from_deg, leeway_deg in ((90.0, -6.0), (270.0, 6.0), (0.0, 0.0), (180.0, 0.0), (30.0, -3.0)):
        _, rows = simulate(f"calm+leeway=0:6:{wind_from_deg}", 2.0)
        assert degrees(math.atan2(rows[-1, 2], rows[-1, 1])) == pytest.approx(leeway_deg, abs=1e-6)


def test_model_mismatch_changes_the_turn():
    _, rows = simulate("calm+kt=2", 60.0, rudder_deg=5.0)
    _, nominal = simulate("calm", 60.0, rudder_deg=5.0)
    assert np.diff(rows[:, 0])[-1] == pytest.approx(2.0 * np.diff(nominal[:, 0])[-1], rel=0.01)
    _, slow = simulate("calm+kt=1:3", 60.0, rudder_deg=5.0)
    # The turn starts later by the difference of the lags.
    assert nominal[-1, 0] - slow[-1, 0] == pytest.approx(8.0 * np.diff(nominal[:, 0])[-1], rel=0.02)


def test_delay_shifts_the_headings_in_time():
    _, delayed = simulate("calm+delay=2", 62.0, rudder_deg=10.0)
    _, nominal = simulate("calm", 60.0, rudder_deg=10.0)
    assert delayed[2:, 0] == pytest.approx(nominal[:, 0], abs=1e-12)
    assert delayed[1, 0] == 0.0


def test_glider_determines_the_course_and_float_the_compass_heading():
    hull, rows = simulate("calm+float=0.3:0.6", 20.0, rudder_deg=20.0)
    glider_rad, float_rad = hull.glider_heading_rad(0.0), hull.float_heading_rad(0.0)
    assert degrees(glider_rad - float_rad) > 2.0
    assert hull.heading_rad(0.0) == float_rad
    assert hull.heading_low_rad(0.0) == glider_rad
    assert math.atan2(rows[-1, 2], rows[-1, 1]) == pytest.approx(glider_rad)
    # Heading and yaw rate of the float are continuous between two grid steps.
    heading_rad, rate_rad_s = hull.float_heading_rad(0.02), hull.yaw_rate_rad_s(0.02)
    hull.step(radians(20.0))
    assert hull.float_heading_rad(0.0) == pytest.approx(heading_rad, abs=1e-7)
    assert hull.yaw_rate_rad_s(0.0) == pytest.approx(rate_rad_s, abs=1e-5)


def test_calm_stops_waves_speed_and_steering():
    text = "swell+speed=0:100:300:600,orbital"
    hull, rows = simulate(text, 300.0)
    speed_m_s = np.hypot(rows[:, 1], rows[:, 2])
    assert speed_m_s[:-1] == pytest.approx(0.7)
    hull, rows = simulate(text, 899.0, rudder_deg=10.0)
    assert hull.speed_m_s < 0.001 * 0.7
    assert abs(hull.heading_rad(0.0) - hull.heading_low_rad(0.0)) < 0.01
    assert np.hypot(*np.subtract(hull.velocity_in_waves_m_s(0.0), hull.velocity_m_s(0.0))) < 0.01
    assert abs(np.diff(rows[-2:, 0])[0]) < 1e-4
    hull, _ = simulate(text, 1200.0, rudder_deg=30.0)
    assert hull.speed_m_s == pytest.approx(0.7, rel=0.01)
    assert hull.yaw_rate_low_rad_s(0.0) > 0.01


def test_speed_with_extreme_options_is_bounded():
    text = "storm+speed=0.6:5,kt=10:0.1,float,leeway=45,sway=5,orbital=3:60:0.65,yaw=50,waves=0.5:0.65,bias=20:10"
    hull, rows = simulate(text, 60.0, rudder_deg=45.0)
    assert np.all(np.isfinite(rows))
    assert hull.speed_m_s <= MAX_SPEED_RATIO * 0.5


@pytest.mark.parametrize("name", ["swell", "ocean-1", "ocean-4", "offshore"])
def test_seed_determines_the_motion(name):
    hulls = [simulate(name, 20.0, seed=seed)[0] for seed in (3, 3, 4)]
    motions = [(hull.compass_heading_rad(0.01), *hull.position_in_waves_m(0.01)) for hull in hulls]
    assert motions[0] == motions[1] != motions[2]


def test_disturbances_do_not_change_the_wave_yaw():
    nominal, disturbed = (simulate(text, 20.0)[0] for text in ("swell", "swell+orbital,leeway,sway,receiver"))
    assert disturbed.heading_rad(0.013) == nominal.heading_rad(0.013)
    assert disturbed.position_in_waves_m(0.0) != nominal.position_in_waves_m(0.0)


def test_yaw_noise_does_not_change_the_other_processes():
    hulls = [simulate(text, 20.0)[0] for text in ("swell", "swell+yaw=2")]
    low_rad = np.array([hull.heading_low_rad(0.0) for hull in hulls])
    wave_rad = np.array([hull.heading_rad(0.0) for hull in hulls]) - low_rad
    assert low_rad[0] != low_rad[1]
    assert wave_rad[0] == pytest.approx(wave_rad[1], abs=1e-12)


def test_own_waves_have_their_own_period():
    hull = Hull(parse_scenario("swell+waves=2:0.1,orbital=0.4:25:0.1"), OCEAN_RAMBLER, 1)
    yaw_rad, north_m = [], []
    for _ in range(400 * STEPS_PER_SECOND):
        hull.step(0.0)
        yaw_rad.append(hull.heading_rad(0.0) - hull.heading_low_rad(0.0))
        north_m.append(hull.position_in_waves_m(0.0)[0] - hull.position_m(0.0)[0])
    for series, period_s in ((yaw_rad, 2.0), (north_m, 8.0)):
        zero_crossings = np.sum(np.diff(np.sign(series)) > 0)
        assert 400.0 / zero_crossings == pytest.approx(period_s, rel=0.1)


def test_bias_option_sets_deviation_and_time_constant():
    # The same numbers are drawn, so the boat turns twice as fast, except for the cubic term.
    headings_rad = [simulate(text, 60.0)[1][-1, 0] for text in ("calm+bias=2:900", "calm+bias=4:900", "calm+bias=4:10")]
    assert headings_rad[1] == pytest.approx(2.0 * headings_rad[0], rel=0.01)
    assert headings_rad[2] != pytest.approx(headings_rad[1], rel=0.1)
    nominal, same = (simulate(text, 20.0)[0] for text in ("swell", "swell+bias=2:100"))
    assert nominal.heading_rad(0.0) == same.heading_rad(0.0)
