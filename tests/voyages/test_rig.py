"""The fast rig against the ship of the HIL: the same sea, so much the same voyage."""

import numpy as np
import pytest

from firmware_py.common.mode_table import Mode
from support import rig


@pytest.mark.proof
@pytest.mark.parametrize(("speed_m_s", "current_m_s"), [(0.4, 0.28), (0.9, 0.45)])
def test_both_hulls_keep_the_same_station(speed_m_s, current_m_s):
    figures = []
    for hull in ({}, {"hull": rig.FineHull}):
        boat = rig.Sailing(rig.scenario(speed_m_s, current_m_s, wave_deg=0.0), 1, LOIT_RADIUS=60.0, **hull)
        boat.under_way(Mode.LOITER)
        boat.run(400.0)
        figures.append(np.array(boat.track)[:, 1:3])
    # Without waves only the grid and the wandering of the rudder's bias differ.
    assert np.abs(figures[0][:200] - figures[1][:200]).max() < 8.0
    # Then each turns when it would leave the circle, by a current not yet known: the farthest is a matter of one turn.
    distance = [np.hypot(*track.T).mean() for track in figures]
    assert distance[0] == pytest.approx(distance[1], abs=12.0)
