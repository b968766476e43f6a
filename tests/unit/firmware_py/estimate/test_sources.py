import math
import random

import pytest

from firmware_py.common.angles import radians, wrap_pi
from firmware_py.estimate.heading_estimator import change_event
from firmware_py.estimate.sources import (
    CompassState,
    Source,
    SourceState,
    TrueHeadingSample,
    add_sample,
    compass_in_use,
    decay_offsets,
    is_frozen,
    is_jumping,
    mark_contradicted,
    select,
    standstill_ratio,
    update_compass,
)

JUMP_GATE_RAD = math.radians(20.0)
PROBATION_S = 10.0

TIMEOUT_S, FROZEN_S = 1.0, 30.0


class Compasses:
    """Two compasses at 10 Hz, their sources, and the headings used in the last tick."""

    def __init__(self, frozen_s=FROZEN_S):
        self.frozen_s, self.state, self.t_s, self.rng = frozen_s, SourceState(), 0.0, random.Random(3)
        self.texts, self.used_rad = [], []

    def run(self, seconds, a=0.0, b=None, *, course_ok=False, expected=1.0):
        """Run with headings of A and B that differ by a, b [rad] from `expected`; None: no data, "frozen": constant."""
        for _ in range(round(10 * seconds)):
            self.t_s += 0.1
            self.state = decay_offsets(self.state, 0.1)
            samples = []
            for source, error in ((0, a), (1, b)):
                if error is not None:
                    noise = self.rng.gauss(0.0, 0.005) if error != "frozen" else 0.0
                    heading_rad = 1.0 if error == "frozen" else (expected + error + noise) % (2 * math.pi)
                    samples.append(TrueHeadingSample(self.t_s, heading_rad, heading_rad, source))
            for sample in samples:
                self.state = add_sample(self.state, sample, expected)
            previous = self.state.in_use
            self.state = select(self.state, self.t_s, self.frozen_s, (TIMEOUT_S, TIMEOUT_S), course_ok)
            if self.state.in_use != previous:
                self.texts.append(change_event(previous, self.state.in_use).text)
            offset_rad = compass_in_use(self.state).offset_rad
            self.used_rad = [
                sample.heading_rad + offset_rad for sample in samples if sample.source == self.state.in_use
            ]
        return self.state.in_use

    @property
    def is_frozen(self):
        return is_frozen(self.state.compasses[0], self.t_s, self.frozen_s, TIMEOUT_S)


def test_compass_a_replaces_compass_b_after_its_probation():
    compasses = Compasses()
    assert compasses.run(5.0, a=None, b=0.0) is Source.COMPASS_B
    assert compasses.run(PROBATION_S - 1.0, b=0.0) is Source.COMPASS_B
    assert compasses.run(2.0, b=0.0) is Source.COMPASS_A
    assert compasses.texts[-1] == "Heading source: compass A (was compass B)"


@pytest.mark.parametrize(("fault", "within_s"), [(None, 1.2), (math.pi, 2.0), (JUMP_GATE_RAD + 0.05, 2.0)])
def test_compass_without_data_or_with_a_jump_is_replaced_by_the_other(fault, within_s):
    compasses = Compasses()
    compasses.run(20.0, b=0.1)
    compasses.texts.clear()
    assert compasses.run(within_s, a=fault, b=0.1) is Source.COMPASS_B
    assert compasses.texts == ["Heading source: compass B (was compass A)"]
    # After its recovery and probation it is used again, with one report.
    assert compasses.run(5.0, b=0.1) is Source.COMPASS_B
    assert compasses.run(PROBATION_S, b=0.1) is Source.COMPASS_A
    assert len(compasses.texts) == 2


def test_change_of_source_causes_no_step_and_its_offset_decays():
    compasses = Compasses()
    off = radians(8.0)
    compasses.run(30.0, b=off)
    compasses.run(1.3, a=None, b=off)
    assert wrap_pi(compasses.used_rad[0] - 1.0) == pytest.approx(0.0, abs=radians(1.6))
    compasses.run(4.0, a=None, b=off)
    assert radians(1.0) < wrap_pi(compasses.used_rad[0] - 1.0) < radians(5.0)
    compasses.run(20.0, a=None, b=off)
    assert wrap_pi(compasses.used_rad[0] - 1.0) == pytest.approx(off, abs=radians(1.6))


def test_recovered_compass_starts_with_its_present_offset():
    """With its former offset it would differ by 40 deg after a turn of 120 deg, and not be used for a minute."""
    compasses = Compasses()
    compasses.run(20.0, course_ok=True)
    for step in range(50):
        compasses.run(1.0, a="frozen", course_ok=True, expected=1.0 + radians(min(4.0 * step, 120.0)))
        compasses.state = mark_contradicted(compasses.state)
    assert compasses.state.in_use is Source.COURSE
    goal = 1.0 + radians(120.0)
    assert compasses.run(PROBATION_S + 0.5, course_ok=True, expected=goal) is Source.COMPASS_A
    assert wrap_pi(compasses.used_rad[0] - goal) == pytest.approx(0.0, abs=radians(1.6))
    assert compasses.run(5.0, course_ok=True, expected=goal) is Source.COMPASS_A


def test_course_is_used_when_no_compass_is_sound():
    compasses = Compasses()
    compasses.run(5.0)
    assert compasses.run(2.0, a=None, course_ok=True) is Source.COURSE
    assert compasses.used_rad == []
    assert compasses.run(1.0, a=None) is Source.NONE
    assert compasses.texts[-2:] == [
        "Heading source: course over ground (was compass A)",
        "Heading lost: course over ground failed",
    ]
    assert compasses.run(0.2) is Source.COMPASS_A


def test_compass_that_rarely_changes_its_reading_is_not_frozen():
    compasses = Compasses()
    for value in range(20):
        compasses.run(FROZEN_S / 2.0, a="frozen")
        compasses.run(0.1, a=radians(0.1) * (value % 2))
    assert compasses.state.in_use is Source.COMPASS_A
    assert len(compasses.texts) == 1


@pytest.mark.parametrize("interval_s", [0.1, 1.0, 2.0])
def test_single_distant_heading_is_no_jump_even_of_a_slow_compass(interval_s):
    state = CompassState()
    for number in range(10):
        state = update_compass(state, TrueHeadingSample(number * interval_s, 1.0, 1.0, 0), 1.0)
    t_s = 10 * interval_s
    distant = update_compass(state, TrueHeadingSample(t_s, 3.0, 3.0, 0), 1.0)
    assert not is_jumping(distant)
    assert not is_jumping(update_compass(distant, TrueHeadingSample(t_s + interval_s, 1.0, 1.0, 0), 1.0))
    for number in range(1, 1 + max(1, round(1.6 / interval_s))):
        distant = update_compass(distant, TrueHeadingSample(t_s + number * interval_s, 3.0, 3.0, 0), 1.0)
    assert is_jumping(distant)


def freeze_in_a_turn():
    """Return two compasses, of which A was constant while the boat turned according to the rudder."""
    compasses = Compasses()
    compasses.run(20.0)
    compasses.run(1.0, a="frozen")
    compasses.state = mark_contradicted(compasses.state)
    return compasses


def test_compass_frozen_in_a_turn_is_not_used_until_its_reading_changes():
    compasses = freeze_in_a_turn()
    assert compasses.run(1.0, a="frozen", b=0.0) is Source.COMPASS_B
    assert compasses.is_frozen
    compasses.run(0.1, b=0.0)
    assert not compasses.is_frozen


@pytest.mark.parametrize("b", [None, 0.0, "frozen"])
def test_constant_reading_without_a_turn_is_no_fault(b):
    compasses = Compasses()
    assert compasses.run(20.0 * FROZEN_S, a="frozen", b=b) is Source.COMPASS_A
    assert not compasses.is_frozen
    assert len(compasses.texts) == 1


def turn_compass_b(compasses, rate_deg_s, seconds):
    """Turn compass B while compass A and the estimate are constant."""
    for tick in range(round(seconds)):
        compasses.run(1.0, a="frozen", b=radians(rate_deg_s) * (tick + 0.5))


@pytest.mark.parametrize("rate_deg_s", [0.5, 2.0])
def test_constant_compass_is_frozen_while_the_other_turns(rate_deg_s):
    compasses = Compasses()
    compasses.run(10.0, a="frozen", b=0.0)
    turn_compass_b(compasses, rate_deg_s, 60.0)
    assert compasses.is_frozen


@pytest.mark.parametrize(
    ("history", "limit_s"),
    [
        (((0.1, 1),), 2.0),  # initial value
        (((5.0, 2),), 10.0),
        (((5.0, 2), (0.5, 1200)), 10.0 * math.exp(-1.0)),  # memory of 10 minutes
        (((0.5, 1200),), 1.5),  # lower limit
    ],
)
def test_standstill_begins_after_twice_the_longest_time_with_one_reading(history, limit_s):
    state, t_s, number = CompassState(sound_since_s=0.0), 0.0, 0
    for interval_s, count in history:
        for _ in range(count):
            t_s, number = t_s + interval_s, number + 1
            state = update_compass(state, TrueHeadingSample(t_s, 1.0, 0.01 * (number % 2), 0), 1.0)
    for ratio in (0.5, 1.0):
        sample = TrueHeadingSample(t_s + ratio * limit_s, 1.0, state.raw_rad, 0)
        assert standstill_ratio(update_compass(state, sample, 1.0)) == pytest.approx(ratio, rel=0.01)


@pytest.mark.parametrize("resolution_deg", [0.1, 1.0, 2.0])
def test_resolution_of_a_compass_is_learned(resolution_deg):
    state, rng = CompassState(), random.Random(1)
    for number in range(100):
        raw_rad = radians(resolution_deg) * round(rng.uniform(-3.0, 3.0) / resolution_deg) % (2.0 * math.pi)
        state = update_compass(state, TrueHeadingSample(0.1 * number, raw_rad, raw_rad, 0), 0.0)
    assert state.turns.resolution_rad == pytest.approx(radians(resolution_deg))


def test_compass_that_recovers_with_the_same_reading_is_not_frozen():
    """The time without data, as of a compass that is off for a night, does not count as a standstill."""
    compasses = Compasses()
    compasses.run(20.0)
    compasses.run(0.1, a="frozen")
    assert compasses.run(2.0 * FROZEN_S, a=None) is Source.NONE
    assert compasses.run(0.1, a="frozen") is Source.COMPASS_A
    assert not compasses.is_frozen


def test_frozen_compass_stays_frozen_after_a_time_without_data():
    compasses = freeze_in_a_turn()
    compasses.run(5.0, a="frozen")
    compasses.run(5.0, a=None)
    assert compasses.run(0.1, a="frozen") is Source.NONE
    assert compasses.is_frozen


@pytest.mark.parametrize(
    ("before_s", "after_s", "share"),
    [
        (2.5, 2.5, 0.5),
        (4.0, 1.0, 0.8),
        (1.0, 8.0, 1.0 / 9.0),
        (100.0, 10.0, math.exp(-1.0)),
        (10.0, 5.0, math.exp(-0.5)),
    ],
)
def test_difference_is_the_mean_of_all_samples_at_first_and_has_a_memory_of_10_s_later(before_s, after_s, share):
    """The offset of a new source is this difference, so it must have little noise."""
    state = CompassState(sound_since_s=0.0)
    for tick in range(1, round(10 * (before_s + after_s)) + 1):
        off_rad = 0.1 if tick <= 10 * before_s else 0.0
        state = update_compass(state, TrueHeadingSample(0.1 * tick, 1.0 + off_rad, 0.01 * tick, 0), 1.0)
    assert state.difference_rad == pytest.approx(0.1 * share, rel=0.02)


def with_difference(seconds, off_rad, state=CompassState(sound_since_s=0.0), begin_s=0.0, expected=1.0):  # noqa: B008 - frozen
    """Return a compass at 10 Hz that has differed by off_rad from the estimate for some seconds."""
    for tick in range(1, round(10 * seconds) + 1):
        sample = TrueHeadingSample(begin_s + 0.1 * tick, 1.0 + off_rad, off_rad + 0.01 * (tick % 7), 0)
        state = update_compass(state, sample, expected)
    return state


def test_differences_before_the_compass_is_sound_are_ignored():
    unsound = with_difference(20.0, 0.3, CompassState())
    assert with_difference(0.1, 0.1, unsound, begin_s=20.0).difference_rad == pytest.approx(0.1)


def test_there_is_no_difference_without_an_estimate():
    state = with_difference(5.0, 0.3, expected=math.nan)
    assert (state.difference_rad, state.agreed) == (0.0, False)
    assert math.isnan(state.steady_rad)
    assert state.near_s == pytest.approx(5.0)
