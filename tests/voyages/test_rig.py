"""The simplified hull of the rig, compared with the hull of the harness in the same sea."""

import numpy as np
import pytest

from firmware_py.common.mode_table import Mode
from support import rig


@pytest.mark.proof
@pytest.mark.parametrize(("speed_m_s", "current_m_s"), [(0.4, 0.28), (0.9, 0.45)])
def test_both_hulls_have_similar_tracks_in_loiter(speed_m_s, current_m_s):
    positions_m = []
    for hull in ({}, {"hull": rig.FineHull}):
        boat = rig.Sailing(rig.scenario(speed_m_s, current_m_s, wave_deg=0.0), 1, LOIT_RADIUS=60.0, **hull)
        boat.get_under_way(Mode.LOITER)
        boat.run(400.0)
        positions_m.append(np.array(boat.track)[:, 1:3])
    # Without waves, only the time grid and the random walk of the rudder bias differ.
    assert np.abs(positions_m[0][:200] - positions_m[1][:200]).max() < 8.0
    # Later each boat turns at the edge of the circle with a current estimate that differs, so only means are compared.
    distance = [np.hypot(*track.T).mean() for track in positions_m]
    assert distance[0] == pytest.approx(distance[1], abs=12.0)
