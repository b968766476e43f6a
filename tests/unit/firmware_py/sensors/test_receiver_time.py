"""A receiver whose weeks have rolled over, and one that says what cannot be."""

import datetime as dt

import pytest

from firmware_py.common.calendar import ROLLOVER_S
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, FixType, PositionSample
from firmware_py.sensors.receiver_time import MIN_AGREEING_FIXES, DatedPosition

NOW_S = dt.datetime(2026, 11, 22, tzinfo=dt.UTC).timestamp()


class Receiver:
    def __init__(self):
        self.utc_s = []

    def fileno(self):
        return 7

    def receive(self, now_s):
        self.received_s = now_s

    def poll(self):
        samples = [PositionSample(float(place), FixType.FIX_3D, utc_s=utc_s) for place, utc_s in enumerate(self.utc_s)]
        self.utc_s = []
        return samples

    def health(self, now_s):
        return DeviceHealth(now_s, DeviceRole.POSITION, DeviceState.RUNNING, 1, 0)


class Dated:
    """A receiver on a computer whose clock, newest log and operator the test has in hand."""

    def __init__(self, clock_s, last_s=0.0):
        self.receiver, self.reports = Receiver(), []
        self.position = DatedPosition(self.receiver, lambda: clock_s, last_s, self.reports.append)

    def times(self, *utc_s):
        self.receiver.utc_s = utc_s
        return [sample.utc_s for sample in self.position.poll()]


def test_it_is_the_receiver_in_all_else():
    dated = Dated(NOW_S)
    dated.position.receive(3.0)
    assert (dated.position.fileno(), dated.receiver.received_s) == (7, 3.0)
    assert dated.position.health(4.0).role is DeviceRole.POSITION
    assert dated.times(NOW_S, None, NOW_S + 2.0) == [NOW_S, None, NOW_S + 2.0]
    assert dated.reports == []


def test_a_week_rollover_is_corrected_from_the_first_fix_and_reported_once():
    dated = Dated(NOW_S + 2.0)
    early = [NOW_S - ROLLOVER_S + second for second in range(20)]
    assert dated.times(*early) == [NOW_S + second for second in range(20)]
    assert dated.reports == ["GPS week rollover: 2007-04-08 corrected to 2026-11-22"]
    assert dated.times(*[NOW_S] * MIN_AGREEING_FIXES) == [NOW_S] * MIN_AGREEING_FIXES
    assert dated.reports[1:] == ["GPS date recovered"]


def test_an_invalid_date_is_removed_and_reported_once():
    dated = Dated(0.0)
    assert dated.times(*[315_964_800.0] * 30) == [None] * 30
    assert dated.reports == ["GPS date 1980-01-06 invalid: time not used"]


@pytest.mark.parametrize("count", range(1, MIN_AGREEING_FIXES))
def test_what_a_receiver_says_as_it_starts_is_not_worth_a_word(count):
    dated = Dated(NOW_S)
    assert dated.times(*[315_964_800.0] * count, NOW_S) == [None] * count + [NOW_S]
    assert dated.reports == []
