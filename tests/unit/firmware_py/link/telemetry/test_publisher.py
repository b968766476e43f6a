"""Reports by satellite at their interval and after a change of mode."""

from firmware_py.common.mode_table import Mode
from support.satellite import SatelliteBoat


def make_boat(interval_min):
    """Return a boat out of reach of the network, whose reports remain queued."""
    return SatelliteBoat(signal=lambda _now_s: 0, parameters={"SBD_REPORT_MIN": interval_min})


def count_reports(boat, now_s, **changes):
    boat.changes |= changes
    boat.run_to(now_s, step_s=now_s - boat.now_s)
    return boat.status().waiting


def test_report_is_sent_at_its_interval():
    boat = make_boat(30.0)
    assert [count_reports(boat, now_s) for now_s in (1.0, 1799.0, 1802.0, 3599.0, 3602.0)] == [1, 1, 2, 2, 3]


def test_six_changes_of_mode_are_reported_then_two_per_hour():
    boat = make_boat(0.0)
    modes = [Mode.GUIDED, Mode.HOLD] * 5
    counts = [count_reports(boat, 1.0 + number, mode=mode) for number, mode in enumerate(modes)]
    assert counts == [1, 2, 3, 4, 5, 6, 7, 7, 7, 7]
    assert [count_reports(boat, now_s) for now_s in (1795.0, 1810.0, 3595.0)] == [7, 8, 8]
    assert count_reports(boat, 3610.0, armed=False) == 9
