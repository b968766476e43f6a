"""The computer's clock is set from GPS if it is wrong and not synchronised, and only by times that agree."""

import math

import pytest

from firmware_py.common.calendar import DAY_S
from firmware_py.common.records import FixType, PositionSample
from firmware_py.system.clock_setter import ClockSetter

FIRST_UTC_S = 1_767_225_600.0
LAST_UTC_S = 4_102_444_800.0
SET_IF_INVALID = 1
SET_IF_UNSYNCHRONISED = 2
SET_NEVER = 0

TRUE_S = FIRST_UTC_S + 1e7


class Computer:
    """A calendar clock, synchronised or not."""

    def __init__(self, utc_s, *, is_synchronised=False, is_permitted=True):
        self.offset_s = utc_s
        self.is_permitted = is_permitted
        self.now_s = 0.0
        self.times_set_s = []
        self.setter = ClockSetter(lambda: self.offset_s + self.now_s, self.set, lambda: is_synchronised)

    def set(self, utc_s):
        self.times_set_s.append(utc_s)
        if self.is_permitted:
            self.offset_s = utc_s - self.now_s
        return self.is_permitted

    def run(self, policy, offsets_s=(None,), seconds=20, station_s=None):
        """Pass a fix per second with its UTC offset, and the time of a station; return the texts of the events."""
        texts = []
        for index in range(seconds):
            if station_s is not None:
                self.setter.add_station_time(station_s + self.now_s, self.now_s)
            self.now_s += 1.0
            offset_s, t_s = offsets_s[index % len(offsets_s)], self.now_s - 0.1
            sample = PositionSample(t_s, FixType.FIX_3D, utc_s=None if offset_s is None else offset_s + t_s)
            texts += [event.text for event in self.setter.update(policy, [sample], self.now_s)]
        return texts


@pytest.mark.parametrize("policy", [SET_IF_INVALID, SET_IF_UNSYNCHRONISED])
@pytest.mark.parametrize("is_synchronised", [False, True])
@pytest.mark.parametrize("wrong_s", [1000.0, LAST_UTC_S + 1000.0, 9.2e9])
def test_an_impossible_clock_is_set_once(policy, is_synchronised, wrong_s):
    computer = Computer(wrong_s, is_synchronised=is_synchronised)
    texts = computer.run(policy, [TRUE_S], 7200)
    assert len(computer.times_set_s) == 1
    assert computer.offset_s == pytest.approx(TRUE_S)
    assert texts == [f"Clock set from GPS: it was {wrong_s - TRUE_S:.0f} s off"]


@pytest.mark.parametrize(
    ("policy", "error_s", "is_synchronised", "count"),
    [
        (SET_NEVER, -TRUE_S, False, 0),
        (SET_IF_INVALID, 100.0, False, 0),  # within its tolerance
        (SET_IF_INVALID, 2 * DAY_S, False, 1),
        (SET_IF_INVALID, -6e6, False, 1),
        (SET_IF_INVALID, 6e8, True, 0),
        (SET_IF_UNSYNCHRONISED, 100.0, False, 1),
        (SET_IF_UNSYNCHRONISED, -100.0, False, 1),
        (SET_IF_UNSYNCHRONISED, 1.95, False, 0),
        (SET_IF_UNSYNCHRONISED, -2.05, False, 1),
        (SET_IF_INVALID, 86_399.0, False, 0),
        (SET_IF_INVALID, -86_401.0, False, 1),
        (SET_IF_UNSYNCHRONISED, 100.0, True, 0),
    ],
)
def test_the_clock_is_set_only_beyond_its_tolerance(policy, error_s, is_synchronised, count):
    computer = Computer(TRUE_S + error_s, is_synchronised=is_synchronised)
    computer.run(policy, [TRUE_S], 60)
    assert len(computer.times_set_s) == count


@pytest.mark.parametrize(
    "offsets_s",
    [
        *([TRUE_S, TRUE_S + error_s] for error_s in (3.0, 1.05, -1.05)),  # they do not agree
        [TRUE_S, TRUE_S, TRUE_S, TRUE_S, TRUE_S + 1e6],
        [FIRST_UTC_S - 1e8],  # a receiver after a week rollover
        *([value] for value in (math.nan, math.inf, 1e300, -1e300, None)),
    ],
)
def test_inconsistent_and_impossible_times_are_ignored(offsets_s):
    computer = Computer(1000.0)
    assert computer.run(SET_IF_INVALID, offsets_s, 300) == []
    assert computer.times_set_s == []


@pytest.mark.parametrize("policy", [SET_IF_INVALID, SET_IF_UNSYNCHRONISED])
def test_a_clock_set_wrong_during_the_run_is_corrected_at_the_next_check_after_a_minute(policy):
    computer = Computer(TRUE_S)
    assert computer.run(policy, [TRUE_S], 20) == []  # checked at 5 s, with the fifth fix
    computer.offset_s += 6e8
    assert computer.run(policy, [TRUE_S], 44) == []
    assert computer.run(policy, [TRUE_S], 1) == ["Clock set from GPS: it was 600000000 s off"]
    assert computer.offset_s == pytest.approx(TRUE_S)


def test_a_missing_permission_is_reported_once_an_hour():
    computer = Computer(1000.0, is_permitted=False)
    texts = computer.run(SET_IF_INVALID, [TRUE_S], 3604)
    assert texts == [f"Clock is {1000.0 - TRUE_S:.0f} s off and may not be set (needs CAP_SYS_TIME)"]
    assert len(computer.run(SET_IF_INVALID, [TRUE_S], 1)) == 1


def test_times_may_differ_by_a_second_and_the_latest_is_used():
    computer = Computer(1000.0)
    computer.run(SET_IF_INVALID, [TRUE_S, TRUE_S - 0.95], 5)
    assert computer.times_set_s == [pytest.approx(TRUE_S + 5.0, abs=1e-5)]
    computer = Computer(1000.0)  # the station does not count while GPS gives times
    assert computer.run(SET_IF_INVALID, [TRUE_S, TRUE_S + 9.0], station_s=TRUE_S) == []


@pytest.mark.parametrize(
    ("policy", "utc_s", "seconds", "texts"),
    [
        (SET_IF_INVALID, 1000.0, 5, [f"Clock set from a ground station: it was {1000.0 - TRUE_S:.0f} s off"]),
        (SET_IF_UNSYNCHRONISED, TRUE_S + 100.0, 9, []),
        (SET_NEVER, 1000.0, 9, []),
    ],
)
def test_without_gps_the_time_of_a_ground_station_corrects_an_impossible_clock(policy, utc_s, seconds, texts):
    assert Computer(utc_s).run(policy, seconds=seconds, station_s=TRUE_S) == texts
