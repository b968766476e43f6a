"""Station keeping: a loiter circle of 100 m, in currents up to 0.7 of the boat's speed and beyond."""

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


def kept(boat, seconds):
    """The true distances from where LOITER was entered, second by second."""
    north_m, east_m = boat.where
    first = len(boat.track)
    boat.run(seconds)
    track = np.array(boat.track[first:])
    return np.hypot(track[:, 1] - north_m, track[:, 2] - east_m)


def test_for_five_minutes():
    boat = rig.Sailing(rig.scenario(0.4, 0.28), LOIT_RADIUS=100.0).under_way(Mode.LOITER)
    assert np.mean(kept(boat, 300.0) <= 100.0) >= 0.95
    assert not boat.times_of("Current too strong")


@pytest.mark.proof
@pytest.mark.parametrize(("speed_m_s", "current_m_s", "more"), CASES)
def test_for_a_day(figures, speed_m_s, current_m_s, more):
    boat = rig.Sailing(rig.scenario(speed_m_s, current_m_s, **more), LOIT_RADIUS=100.0).under_way(Mode.LOITER)
    distance_m = kept(boat, 86_400.0)
    inside = np.mean(distance_m <= 100.0)
    case = f"{speed_m_s} m/s, current {current_m_s} m/s {more}"
    figures.keep("station_day_outside", 100.0 * (1.0 - inside), "%", case)
    figures.keep("station_day_farthest", distance_m.max(), "m", case)
    assert inside >= 0.95
    assert distance_m.max() < 150.0


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("more", [{}, {"tide_s": 44712.0, "tide_rotary": 0.6}])
def test_for_two_hours_without_a_receiver(figures, more, seed):
    boat = rig.Sailing(rig.scenario(0.5, 0.2, 60.0, **more), seed, LOIT_RADIUS=100.0).under_way(Mode.LOITER)
    boat.run(1800.0)
    boat.fix_every = 10**9
    farthest_m = kept(boat, 7200.0).max()
    dead_reckoning = boat.snapshot.dead_reckoning
    north_m, east_m = Place(*placed(0.0, 0.0)).offset_m(
        Place(dead_reckoning.latitude_rad, dead_reckoning.longitude_rad)
    )
    off_m = math.hypot(north_m - boat.where[0], east_m - boat.where[1])
    case = f"seed {seed} {more}"
    figures.keep("station_silent_farthest", farthest_m, "m", case)
    figures.keep("station_silent_off", off_m, "m", case)
    figures.keep("station_silent_sd", dead_reckoning.sd_m, "m", case)
    assert off_m < 3.0 * dead_reckoning.sd_m
    assert farthest_m < 200.0 + 3.0 * dead_reckoning.sd_m < 3000.0


@pytest.mark.parametrize("boot", [pytest.param("same", marks=pytest.mark.proof), "other"])
def test_a_restart_without_a_receiver_keeps_the_station(boot):
    boat = rig.Sailing(rig.scenario(0.6, 0.1), 1, BOOT_RESUME=2)
    boat.under_way(Mode.LOITER)
    boat.run(100.0)
    boat.fix_every = 10**9
    text = resume.to_bytes(resume.resume_of(boat.state, resume.Moment(0.0, "same", boat.t_s)))
    fresh = State.at_start(boat.state.parameters, boat.state.plans)
    boat.state, _ = resume.restore(fresh, text, resume.Moment(0.0, boot, boat.t_s))
    first = len(boat.track)
    boat.run(15.0)
    assert boat.snapshot.dead_reckoning.time_since_fix_s == pytest.approx(15.0, abs=1.5)
    assert boat.snapshot.goal_heading_rad is not None
    assert not boat.snapshot.faults >> Fault.POSITION_LOST & 1  # a receiver switched on with the boat still searches
    boat.run(180.0)
    assert np.hypot(*np.array(boat.track[first:])[:, 1:3].T).max() < 110.0
    assert boat.snapshot.faults >> Fault.POSITION_LOST & 1
    assert (boat.snapshot.dead_reckoning.sd_m > 1e5) is (boot == "other")


def stronger(speed_m_s, seed, **more):
    boat = rig.Sailing(rig.scenario(speed_m_s, 1.2 * speed_m_s, **more), seed).under_way(Mode.LOITER)
    boat.run(1800.0)
    report_s = boat.times_of("Current too strong")
    into_deg = math.degrees(boat.track[-1][3]) - (more.get("toward_deg", 90.0) + 180.0)
    return report_s, abs(math.remainder(into_deg, 360.0))


@pytest.mark.proof
def test_a_current_of_1_2_times_the_speed_is_detected_and_pointed_into():
    report_s, off_deg = stronger(0.4, 1)
    assert report_s
    assert report_s[0] <= 1800.0
    assert off_deg < 15.0


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize(("speed_m_s", "toward_deg"), [(0.25, 0.0), (0.4, 180.0), (0.5, 90.0), (0.9, 300.0)])
def test_recognised_at_any_speed_and_from_any_side(figures, speed_m_s, toward_deg, seed):
    report_s, off_deg = stronger(speed_m_s, seed, toward_deg=toward_deg)
    assert report_s
    case = f"{speed_m_s} m/s toward {toward_deg:.0f} deg, seed {seed}"
    figures.keep("strong_current_reported", report_s[0], "s", case)
    figures.keep("strong_current_off", off_deg, "deg", case)
    assert off_deg < 20.0


def test_return_to_home():
    boat = rig.Sailing(rig.scenario(1.2, 0.2), LOIT_RADIUS=60.0)
    boat.under_way(Mode.GUIDED)
    boat.run(90.0)
    assert math.hypot(*boat.where) > 80.0
    boat.under_way(Mode.RTL)
    boat.run(2000.0, until=lambda boat: boat.snapshot.navigation.arrived)
    first = len(boat.track)
    boat.run(150.0)
    assert np.mean(np.hypot(*np.array(boat.track[first:])[:, 1:3].T) <= 65.0) > 0.95
