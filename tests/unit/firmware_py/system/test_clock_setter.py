"""The computer's clock is set from GPS only when it has no better time, and never by one wrong word."""

import math

import pytest

from firmware_py.common.calendar import DAY_S, FIRST_UTC_S, LAST_UTC_S
from firmware_py.common.records import FixType, PositionSample
from firmware_py.system.clock_setter import SET_IF_INVALID, SET_IF_UNSYNCHRONISED, SET_NEVER, ClockSetter

TRUE_S = FIRST_UTC_S + 1e7


class Computer:
    """A calendar clock, synchronised or not."""

    def __init__(self, utc_s, *, kept=False, may=True):
        self.offset_s = utc_s
        self.kept, self.may = kept, may
        self.now_s = 0.0
        self.sets = []
        self.setter = ClockSetter(lambda: self.offset_s + self.now_s, self.set, lambda: self.kept)

    def set(self, utc_s):
        self.sets.append(utc_s)
        if self.may:
            self.offset_s = utc_s - self.now_s
        return self.may

    def turn(self, policy, fixes=(), count=20):
        """Turn for some seconds with a fix each; return the texts of the events."""
        texts = []
        for index in range(count):
            self.now_s += 1.0
            utc_s = fixes[index % len(fixes)] if fixes else None
            utc_s = None if utc_s is None else utc_s + self.now_s
            sample = PositionSample(self.now_s - 0.1, FixType.FIX_3D, utc_s=None if utc_s is None else utc_s - 0.1)
            texts += [event.text for event in self.setter.update(policy, [sample], self.now_s)]
        return texts


@pytest.mark.parametrize("policy", [SET_IF_INVALID, SET_IF_UNSYNCHRONISED])
@pytest.mark.parametrize("kept", [False, True])
@pytest.mark.parametrize("shown_s", [1000.0, LAST_UTC_S + 1000.0, 9.2e9])
def test_an_impossible_clock_is_set_once(policy, kept, shown_s):
    computer = Computer(shown_s, kept=kept)
    texts = computer.turn(policy, [TRUE_S], 7200)
    assert len(computer.sets) == 1
    assert computer.offset_s == pytest.approx(TRUE_S)
    assert texts == [f"Clock set from GPS: it was {shown_s - TRUE_S:.0f} s off"]


@pytest.mark.parametrize(
    ("policy", "error_s", "kept", "sets"),
    [
        (SET_NEVER, -TRUE_S, False, 0),
        (SET_IF_INVALID, 100.0, False, 0),  # wrong, but not plainly
        (SET_IF_INVALID, 2 * DAY_S, False, 1),
        (SET_IF_INVALID, -6e6, False, 1),
        (SET_IF_INVALID, 6e8, True, 0),
        (SET_IF_UNSYNCHRONISED, 100.0, False, 1),
        (SET_IF_UNSYNCHRONISED, -100.0, False, 1),
        (SET_IF_UNSYNCHRONISED, 1.5, False, 0),
        (SET_IF_UNSYNCHRONISED, 100.0, True, 0),  # NTP knows better
    ],
)
def test_the_clock_is_set_only_beyond_its_tolerance(policy, error_s, kept, sets):
    computer = Computer(TRUE_S + error_s, kept=kept)
    computer.turn(policy, [TRUE_S], 60)
    assert len(computer.sets) == sets


@pytest.mark.parametrize(
    "fixes",
    [
        [TRUE_S, TRUE_S + 3.0],  # they do not agree
        [TRUE_S, TRUE_S, TRUE_S, TRUE_S, TRUE_S + 1e6],
        [FIRST_UTC_S - 1e8],  # a receiver whose week has rolled over
        [math.nan], [math.inf], [1e300], [-1e300],
        [None],
    ],
)  # fmt: skip
def test_inconsistent_and_impossible_times_are_ignored(fixes):
    computer = Computer(1000.0)
    assert computer.turn(SET_IF_INVALID, fixes, 300) == []
    assert computer.sets == []


@pytest.mark.parametrize("policy", [SET_IF_INVALID, SET_IF_UNSYNCHRONISED])
def test_a_clock_set_wrong_during_the_run_is_corrected_within_two_minutes(policy):
    computer = Computer(TRUE_S)
    assert computer.turn(policy, [TRUE_S], 300) == []
    computer.offset_s += 6e8
    assert computer.turn(policy, [TRUE_S], 120) == ["Clock set from GPS: it was 600000000 s off"]
    assert computer.offset_s == pytest.approx(TRUE_S)


def test_a_missing_permission_is_reported_once_an_hour():
    computer = Computer(1000.0, may=False)
    texts = computer.turn(SET_IF_INVALID, [TRUE_S], 7000)
    assert len(texts) == len(computer.sets) == 2
    assert "CAP_SYS_TIME" in texts[0]


def test_the_time_of_a_ground_station_is_used_without_gps():
    computer = Computer(1000.0)
    for _ in range(5):
        computer.setter.add_station_time(TRUE_S + computer.now_s, computer.now_s)
        texts = computer.turn(SET_IF_INVALID, count=1)
    assert texts == [f"Clock set from a ground station: it was {1000.0 - TRUE_S:.0f} s off"]
    for policy, utc_s in ((SET_IF_UNSYNCHRONISED, TRUE_S + 100.0), (SET_NEVER, 1000.0)):
        computer = Computer(utc_s)
        for _ in range(9):
            computer.setter.add_station_time(TRUE_S + computer.now_s, computer.now_s)
            computer.turn(policy, count=1)
        assert computer.sets == []
