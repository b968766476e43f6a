"""Correction of the time of a receiver after a week number rollover, and its reports."""

import datetime as dt

import pytest

from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, FixType, PositionSample
from firmware_py.sensors.receiver_time import TimeCorrectedPosition

ROLLOVER_S = 1024.0 * 7.0 * 86_400.0  # GPS weeks have 10 bits
MIN_AGREEING_FIXES = 5

NOW_S = dt.datetime(2026, 11, 22, tzinfo=dt.UTC).timestamp()
GPS_EPOCH_S = dt.datetime(1980, 1, 6, tzinfo=dt.UTC).timestamp()


class Receiver:
    def __init__(self):
        self.utc_s = []

    def fileno(self):
        return 7

    def receive(self, now_s):
        self.received_s = now_s

    def poll(self):
        samples = [PositionSample(float(index), FixType.FIX_3D, utc_s=utc_s) for index, utc_s in enumerate(self.utc_s)]
        self.utc_s = []
        return samples

    def health(self, now_s):
        return DeviceHealth(now_s, DeviceRole.POSITION, DeviceState.RUNNING, 1, 0)


class Setup:
    """A receiver, the clock of the computer, and the reports to the operator."""

    def __init__(self, clock_s):
        self.receiver, self.reports = Receiver(), []
        self.position = TimeCorrectedPosition(self.receiver, lambda: clock_s, 0.0, self.reports.append)

    def corrected(self, *utc_s):
        self.receiver.utc_s = utc_s
        return [sample.utc_s for sample in self.position.poll()]


def test_other_data_of_the_receiver_are_unchanged():
    setup = Setup(NOW_S)
    setup.position.receive(3.0)
    assert (setup.position.fileno(), setup.receiver.received_s) == (7, 3.0)
    assert setup.position.health(4.0).role is DeviceRole.POSITION
    assert setup.corrected(NOW_S, None, NOW_S + 2.0) == [NOW_S, None, NOW_S + 2.0]
    assert setup.reports == []


def test_week_rollover_is_corrected_from_the_first_fix_and_reported_once():
    setup = Setup(NOW_S + 2.0)
    early = [NOW_S - ROLLOVER_S + second for second in range(20)]
    assert setup.corrected(*early) == [NOW_S + second for second in range(20)]
    assert setup.reports == ["GPS week rollover: 2007-04-08 corrected to 2026-11-22"]
    assert setup.corrected(*[NOW_S] * MIN_AGREEING_FIXES) == [NOW_S] * MIN_AGREEING_FIXES
    assert setup.reports[1:] == ["GPS date recovered"]


def test_impossible_date_is_removed_and_reported_once():
    setup = Setup(0.0)
    assert setup.corrected(*[GPS_EPOCH_S] * 30) == [None] * 30
    assert setup.reports == ["GPS date 1980-01-06 invalid: time not used"]


@pytest.mark.parametrize("count", [1, MIN_AGREEING_FIXES - 1])
def test_few_wrong_dates_during_the_start_are_not_reported(count):
    setup = Setup(NOW_S)
    assert setup.corrected(*[GPS_EPOCH_S] * count, NOW_S) == [None] * count + [NOW_S]
    assert setup.reports == []
