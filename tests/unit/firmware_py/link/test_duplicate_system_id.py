"""Frames with the ids of the boat: looped back by wiring, or sent by another vehicle."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

NOTICE = "Duplicate system id 1 on the link: change LNK_SYSID"


@pytest.fixture
def send_as_boat(rig, texts):
    """Send messages with the ids of the boat (1, 1), one each `every_s`; return the texts that the boat reports."""
    rig.now_s = 100.0
    rig.tick()

    def send(*messages, every_s=1.0):
        reports = []
        for message in messages:
            rig.station.srcSystem, rig.station.srcComponent = 1, 1
            reports += texts(rig.send(message))
            rig.now_s += every_s
            rig.utc_s += every_s
        return reports

    return send


def system_time(rig, *, behind_s=0.0, clock_s=0.0, started_s=0.0):
    """SYSTEM_TIME of age `behind_s`; UTC and time since boot differ by `clock_s` and `started_s` from the boat's."""
    utc_us = int((rig.utc_s - behind_s + clock_s) * 1e6)
    return mavlink.MAVLink_system_time_message(utc_us, round((rig.now_s - behind_s + started_s) * 1e3) & 0xFFFFFFFF)


@pytest.mark.parametrize(
    "other", [{"started_s": 2.1}, {"started_s": -60.5, "clock_s": -60.5}, {"clock_s": 2.1}, {"clock_s": -2.1}]
)
def test_vehicle_with_other_clocks_is_reported_every_ten_minutes(rig, send_as_boat, other):
    rig.now_s = 128.0
    assert [send_as_boat(system_time(rig, **other)) for _ in range(5)] == [[], [], [], [], [NOTICE]]
    for now_s, reports in ((731.9, []), (732.0, [NOTICE])):
        rig.utc_s += now_s - rig.now_s
        rig.now_s = now_s
        assert send_as_boat(system_time(rig, **other), every_s=0.0) == reports


def test_boat_with_another_autopilot_is_detected(send_as_boat):
    px4, boat = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_SURFACE_BOAT
    other_autopilot = mavlink.MAVLink_heartbeat_message(boat, px4, 0, 0, 4, 3)
    assert send_as_boat(*[other_autopilot] * 6) == [NOTICE]


@pytest.mark.parametrize("behind_s", [-1.9, 0.0, 0.5, 59.5])
def test_own_looped_frames_are_not_reported(rig, send_as_boat, behind_s):
    heartbeat = mavlink.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3)  # type and autopilot of the boat itself
    for _ in range(20):
        assert send_as_boat(system_time(rig, behind_s=behind_s), heartbeat, every_s=0.5) == []
    rig.now_s = 2.0**32 * 1e-3 + 0.2  # time_boot_ms of 32 bits has wrapped
    for _ in range(20):
        assert send_as_boat(system_time(rig, behind_s=behind_s)) == []


def test_clock_may_differ_by_two_seconds_or_be_unknown(rig, send_as_boat):
    for clock_s in (1.9, -1.9, -rig.utc_s):
        assert send_as_boat(*[system_time(rig, clock_s=clock_s) for _ in range(6)], every_s=0.0) == []


def test_clock_step_during_a_loop_is_not_reported(rig, send_as_boat):
    late = [system_time(rig, behind_s=0.1, clock_s=3600.0) for _ in range(4)]
    assert send_as_boat(*late, system_time(rig), *late) == []
