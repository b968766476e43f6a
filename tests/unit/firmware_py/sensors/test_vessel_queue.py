"""Limits of the queue of reports of other vessels."""

import pytest

from firmware_py.common.vessels import VesselIdentity, VesselKind, VesselPosition
from firmware_py.sensors.vessel_queue import VesselQueue


def position(mmsi, t_s=1.0):
    return VesselPosition(t_s, mmsi, VesselKind.CLASS_A, 0.1, 0.2)


def test_256_reports_wait_and_only_a_known_vessel_is_updated_then():
    queue = VesselQueue()
    assert all(queue.add(position(mmsi)) for mmsi in range(256))
    assert not queue.add(position(256))
    assert not queue.add(VesselIdentity(1.0, 7))
    assert queue.add(position(7, 2.0))
    taken = [report for _ in range(7) for report in queue.take()]
    assert len(taken) == 256
    assert taken[7].t_s == 2.0
    assert queue.take() == ()


@pytest.mark.parametrize(("waiting", "taken"), [(39, [39]), (40, [40]), (41, [40, 1])])
def test_forty_reports_are_taken_in_a_tick(waiting, taken):
    queue = VesselQueue()
    for mmsi in range(waiting):
        queue.add(position(mmsi))
    assert [len(queue.take()) for _ in taken] == taken


def test_positions_are_taken_before_identities():
    queue = VesselQueue()
    queue.add(VesselIdentity(1.0, 5, "ANNA"))
    queue.add(position(5))
    queue.add(VesselIdentity(2.0, 5, call_sign="DA1"))
    first, second = queue.take()
    assert (type(first), second.name, second.call_sign) == (VesselPosition, "ANNA", "DA1")
