"""Station keeping in a loiter circle of 100 m, in currents up to 0.7 of the boat's speed, and in stronger ones."""

import math

import numpy as np
import pytest

from firmware_py.common.geodesy import Place
from firmware_py.common.mode_table import Mode
from firmware_py.core import resume
from firmware_py.core.state import State
from firmware_py.faults.table import Fault
from support import rig
from support.plans import placed

CASES = [
    (0.4, 0.0, {}),
    (0.4, 0.28, {}),
    (0.9, 0.63, {"toward_deg": 210.0}),
    (0.2, 0.14, {"wave_deg": 10.0, "wave_s": 4.0}),
    (0.5, 0.35, {"tide_s": 44712.0, "tide_rotary": 0.6}),
    (0.7, 0.49, {"wave_deg": 20.0, "wave_s": 8.0}),
]


def distances_in_loiter(boat, seconds):
    """Return the true distance from the present position at each second of a time."""
    north_m, east_m = boat.where
    first_row = len(boat.track)
    boat.run(seconds)
    track = np.array(boat.track[first_row:])
    return np.hypot(track[:, 1] - north_m, track[:, 2] - east_m)


def test_boat_stays_in_the_circle_for_five_minutes():
    boat = rig.Sailing(rig.scenario(0.4, 0.28), LOIT_RADIUS=100.0).get_under_way(Mode.LOITER)
    assert np.mean(distances_in_loiter(boat, 300.0) <= 100.0) >= 0.95
    assert not boat.times_of("Current too strong")


@pytest.mark.proof
@pytest.mark.parametrize(("speed_m_s", "current_m_s", "options"), CASES)
def test_boat_stays_in_the_circle_for_a_day(figures, speed_m_s, current_m_s, options):
    boat = rig.Sailing(rig.scenario(speed_m_s, current_m_s, **options), LOIT_RADIUS=100.0).get_under_way(Mode.LOITER)
    distance_m = distances_in_loiter(boat, 86_400.0)
    inside_fraction = np.mean(distance_m <= 100.0)
    case = f"{speed_m_s} m/s, current {current_m_s} m/s {options}"
    figures.keep("station_day_outside", 100.0 * (1.0 - inside_fraction), "%", case)
    figures.keep("station_day_farthest", distance_m.max(), "m", case)
    assert inside_fraction >= 0.95
    assert distance_m.max() < 150.0


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("options", [{}, {"tide_s": 44712.0, "tide_rotary": 0.6}])
def test_distance_without_a_receiver_is_limited_for_two_hours(figures, options, seed):
    boat = rig.Sailing(rig.scenario(0.5, 0.2, 60.0, **options), seed, LOIT_RADIUS=100.0).get_under_way(Mode.LOITER)
    boat.run(1800.0)
    boat.fix_ticks = 10**9
    max_distance_m = distances_in_loiter(boat, 7200.0).max()
    dead_reckoning = boat.snapshot.dead_reckoning
    north_m, east_m = Place(*placed(0.0, 0.0)).offset_m(
        Place(dead_reckoning.latitude_rad, dead_reckoning.longitude_rad)
    )
    error_m = math.hypot(north_m - boat.where[0], east_m - boat.where[1])
    case = f"seed {seed} {options}"
    figures.keep("station_silent_farthest", max_distance_m, "m", case)
    figures.keep("station_silent_off", error_m, "m", case)
    figures.keep("station_silent_sd", dead_reckoning.sd_m, "m", case)
    assert error_m < 3.0 * dead_reckoning.sd_m
    assert max_distance_m < 200.0 + 3.0 * dead_reckoning.sd_m < 3000.0


@pytest.mark.parametrize("boot", [pytest.param("same", marks=pytest.mark.proof), "other"])
def test_restart_without_a_receiver_keeps_the_station(boot):
    boat = rig.Sailing(rig.scenario(0.6, 0.1), 1, BOOT_RESUME=2)
    boat.get_under_way(Mode.LOITER)
    boat.run(100.0)
    boat.fix_ticks = 10**9
    stored = resume.to_bytes(resume.resume_of(boat.state, resume.Moment(0.0, "same", boat.t_s)))
    new_state = State.at_start(boat.state.parameters, boat.state.plans)
    boat.state, _ = resume.restore(new_state, stored, resume.Moment(0.0, boot, boat.t_s))
    first_row = len(boat.track)
    boat.run(15.0)
    assert boat.snapshot.dead_reckoning.time_since_fix_s == pytest.approx(15.0, abs=1.5)
    assert boat.snapshot.goal_heading_rad is not None
    assert not boat.snapshot.faults >> Fault.POSITION_LOST & 1  # after a start the receiver may still search
    boat.run(180.0)
    assert np.hypot(*np.array(boat.track[first_row:])[:, 1:3].T).max() < 110.0
    assert boat.snapshot.faults >> Fault.POSITION_LOST & 1
    assert (boat.snapshot.dead_reckoning.sd_m > 1e5) is (boot == "other")


def loiter_in_strong_current(speed_m_s, seed, **options):
    boat = rig.Sailing(rig.scenario(speed_m_s, 1.2 * speed_m_s, **options), seed).get_under_way(Mode.LOITER)
    boat.run(1800.0)
    report_s = boat.times_of("Current too strong")
    deviation_deg = math.degrees(boat.track[-1][3]) - (options.get("toward_deg", 90.0) + 180.0)
    return report_s, abs(math.remainder(deviation_deg, 360.0))


@pytest.mark.proof
def test_boat_heads_into_a_current_of_1_2_times_its_speed():
    report_s, error_deg = loiter_in_strong_current(0.4, 1)
    assert report_s
    assert report_s[0] <= 1800.0
    assert error_deg < 15.0


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize(("speed_m_s", "toward_deg"), [(0.25, 0.0), (0.4, 180.0), (0.5, 90.0), (0.9, 300.0)])
def test_strong_current_is_reported_at_each_speed_and_direction(figures, speed_m_s, toward_deg, seed):
    report_s, error_deg = loiter_in_strong_current(speed_m_s, seed, toward_deg=toward_deg)
    assert report_s
    case = f"{speed_m_s} m/s toward {toward_deg:.0f} deg, seed {seed}"
    figures.keep("strong_current_reported", report_s[0], "s", case)
    figures.keep("strong_current_off", error_deg, "deg", case)
    assert error_deg < 20.0


def test_boat_returns_to_home_and_stays():
    boat = rig.Sailing(rig.scenario(1.2, 0.2), LOIT_RADIUS=60.0)
    boat.get_under_way(Mode.GUIDED)
    boat.run(90.0)
    assert math.hypot(*boat.where) > 80.0
    boat.get_under_way(Mode.RTL)
    boat.run(2000.0, until=lambda boat: boat.snapshot.navigation.arrived)
    first_row = len(boat.track)
    boat.run(150.0)
    assert np.mean(np.hypot(*np.array(boat.track[first_row:])[:, 1:3].T) <= 65.0) > 0.95
