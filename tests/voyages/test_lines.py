"""Line following at sea in a current of half the boat's speed."""

import numpy as np
import pytest

from firmware_py.common.intents import SteerPosition
from firmware_py.common.mode_table import Mode
from firmware_py.common.reports import MissionState
from support import rig
from support.plans import item, mission, placed


def cross_tracks(boat, seconds):
    """Sail the mission; return the true distance to the line of the present leg at each second."""
    corners = [(0.0, 0.0), *boat.corners]
    distances_m = []
    for _ in range(seconds):
        boat.run(1.0)
        if boat.snapshot.mission.state is MissionState.COMPLETE:
            break
        index = boat.snapshot.mission.index
        start, end = np.array(corners[index]), np.array(corners[index + 1])
        direction = (end - start) / np.linalg.norm(end - start)
        position = np.array(boat.where) - start
        distances_m.append(abs(direction[0] * position[1] - direction[1] * position[0]))
    return np.array(distances_m)


def start_mission(corners, seed, **current):
    plans = mission(*(item(16, *corner) for corner in corners))
    boat = rig.Sailing(rig.sea("sea", current_m_s=0.45, **current), seed, plans)
    boat.corners = corners
    return boat.get_under_way(Mode.AUTO)


@pytest.mark.proof
def test_cross_track_error_below_15_m_in_a_current_of_half_the_speed():
    boat = start_mission([(500.0, 0.0), (500.0, 400.0)], 1)
    distances_m = cross_tracks(boat, 1500)
    assert boat.snapshot.mission.state is MissionState.COMPLETE
    assert np.percentile(distances_m, 95) <= 15.0


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize("toward_deg", [0.0, 60.0, 90.0, 210.0])
def test_cross_track_error_on_a_square_in_currents_of_half_the_speed(figures, seed, toward_deg):
    corners = [(1500.0, 0.0), (1500.0, 1500.0), (0.0, 1500.0), (0.0, 0.0)]
    boat = start_mission(corners, seed, current_toward_deg=toward_deg)
    distances_m = cross_tracks(boat, 14_400)
    figures.keep("line_p95", np.percentile(distances_m, 95), "m", f"seed {seed} toward {toward_deg:.0f} deg")
    figures.keep("line_largest", distances_m.max(), "m", f"seed {seed} toward {toward_deg:.0f} deg")
    assert boat.snapshot.mission.state is MissionState.COMPLETE
    assert np.percentile(distances_m, 95) <= 15.0


def test_guided_position_is_reached_and_kept():
    boat = rig.Sailing(rig.scenario(1.2, 0.3), 2, LOIT_RADIUS=60.0)
    boat.get_under_way(Mode.GUIDED, SteerPosition(*placed(120.0, -90.0)))
    boat.run(1500.0, until=lambda boat: boat.snapshot.navigation.arrived)
    assert boat.snapshot.navigation.arrived
    track = len(boat.track)
    boat.run(120.0)
    north_m, east_m = np.array(boat.track[track:])[:, 1:3].T
    assert np.mean(np.hypot(north_m - 120.0, east_m + 90.0) <= 62.0) > 0.95
