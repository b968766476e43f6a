import math
import random

import pytest

from firmware_py.common.angles import radians, wrap_pi
from firmware_py.estimate.heading_estimator import change_event
from firmware_py.estimate.sources import (
    JUMP_GATE_RAD,
    PROBATION_S,
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

TIMEOUT_S, FROZEN_S = 1.0, 30.0


class Watch:
    """Two compasses around an estimate, ten times a second."""

    def __init__(self, frozen_s=FROZEN_S):
        self.frozen_s = frozen_s
        self.state = SourceState()
        self.t_s = 0.0
        self.rng = random.Random(3)
        self.texts = []
        self.used = []

    def run(self, seconds, a=0.0, b=None, *, course_ok=False, expected=1.0):
        """Each compass shows the estimate plus its offset here; None: silent, a text: frozen."""
        for _ in range(round(10 * seconds)):
            self.t_s += 0.1
            self.state = decay_offsets(self.state, 0.1)
            samples = []
            for source, off in ((0, a), (1, b)):
                if off is not None:
                    value = 1.0 if off == "frozen" else (expected + off + self.rng.gauss(0.0, 0.005)) % (2 * math.pi)
                    samples.append(TrueHeadingSample(self.t_s, value, value, source))
            for sample in samples:
                self.state = add_sample(self.state, sample, expected)
            before = self.state.in_use
            self.state = select(self.state, self.t_s, self.frozen_s, (TIMEOUT_S, TIMEOUT_S), course_ok)
            if self.state.in_use != before:
                self.texts.append(change_event(before, self.state.in_use).text)
            offset_rad = compass_in_use(self.state).offset_rad
            self.used = [sample.heading_rad + offset_rad for sample in samples if sample.source == self.state.in_use]
        return self.state.in_use


def test_the_first_compass_with_data_is_used_at_once():
    watch = Watch()
    assert watch.run(0.1) is Source.COMPASS_A
    assert watch.texts == ["Heading source: compass A"]
    assert len(watch.used) == 1


def test_compass_b_is_used_alone_and_a_takes_over_after_its_probation():
    watch = Watch()
    assert watch.run(5.0, a=None, b=0.0) is Source.COMPASS_B
    assert watch.run(PROBATION_S - 1.0, b=0.0) is Source.COMPASS_B
    assert watch.run(2.0, b=0.0) is Source.COMPASS_A
    assert watch.texts[-1] == "Heading source: compass A (was compass B)"


@pytest.mark.parametrize(("fault", "within_s"), [(None, 1.2), (math.pi, 2.0), (JUMP_GATE_RAD + 0.05, 2.0)])
def test_a_silent_or_jumping_compass_is_replaced_by_the_other(fault, within_s):
    watch = Watch()
    watch.run(20.0, b=0.1)
    watch.texts.clear()
    assert watch.run(within_s, a=fault, b=0.1) is Source.COMPASS_B
    assert watch.texts == ["Heading source: compass B (was compass A)"]
    # After its recovery it is used again after its probation, with one report.
    assert watch.run(5.0, b=0.1) is Source.COMPASS_B
    assert watch.run(PROBATION_S, b=0.1) is Source.COMPASS_A
    assert len(watch.texts) == 2


def test_a_change_of_source_causes_no_step_and_its_offset_decays():
    watch = Watch()
    off = radians(8.0)
    watch.run(30.0, b=off)
    watch.run(1.3, a=None, b=off)
    assert wrap_pi(watch.used[0] - 1.0) == pytest.approx(0.0, abs=radians(1.6))
    watch.run(4.0, a=None, b=off)
    assert radians(1.0) < wrap_pi(watch.used[0] - 1.0) < radians(5.0)
    watch.run(20.0, a=None, b=off)
    assert wrap_pi(watch.used[0] - 1.0) == pytest.approx(off, abs=radians(1.6))


def test_a_recovered_compass_starts_with_its_present_offset():
    """After a turn of 120 deg while it was frozen, it would be 40 deg off and not used for a minute."""
    watch = Watch()
    watch.run(20.0, course_ok=True)
    for step in range(50):
        watch.run(1.0, a="frozen", course_ok=True, expected=1.0 + radians(min(4.0 * step, 120.0)))
        watch.state = mark_contradicted(watch.state)
    assert watch.state.in_use is Source.COURSE
    goal = 1.0 + radians(120.0)
    assert watch.run(PROBATION_S + 0.5, course_ok=True, expected=goal) is Source.COMPASS_A
    assert wrap_pi(watch.used[0] - goal) == pytest.approx(0.0, abs=radians(1.6))
    assert watch.run(5.0, course_ok=True, expected=goal) is Source.COMPASS_A


def test_the_course_is_the_last_source():
    watch = Watch()
    watch.run(5.0)
    assert watch.run(2.0, a=None, course_ok=True) is Source.COURSE
    assert watch.used == []
    assert watch.run(1.0, a=None) is Source.NONE
    assert watch.texts[-2:] == [
        "Heading source: course over ground (was compass A)",
        "Heading lost: course over ground failed",
    ]
    assert watch.run(0.2) is Source.COMPASS_A


def test_a_course_alone_does_not_start_the_estimate():
    assert Watch().run(5.0, a=None, course_ok=True) is Source.NONE


def test_a_constant_compass_ashore_is_not_frozen():
    watch = Watch(frozen_s=0.0)
    assert watch.run(10.0 * FROZEN_S, a="frozen") is Source.COMPASS_A


def test_a_compass_that_rarely_changes_its_number_is_not_frozen():
    watch = Watch()
    for value in range(20):
        watch.run(FROZEN_S / 2.0, a="frozen")
        watch.run(0.1, a=radians(0.1) * (value % 2))
    assert watch.state.in_use is Source.COMPASS_A
    assert len(watch.texts) == 1


@pytest.mark.parametrize("interval_s", [0.1, 1.0, 2.0])
def test_one_distant_heading_is_no_jump_even_of_a_slow_compass(interval_s):
    state = CompassState()
    for number in range(10):
        state = update_compass(state, TrueHeadingSample(number * interval_s, 1.0, 1.0, 0), 1.0)
    off_s = 10 * interval_s
    off = update_compass(state, TrueHeadingSample(off_s, 3.0, 3.0, 0), 1.0)
    assert not is_jumping(off)
    assert not is_jumping(update_compass(off, TrueHeadingSample(off_s + interval_s, 1.0, 1.0, 0), 1.0))
    for number in range(1, 1 + max(1, round(1.6 / interval_s))):
        off = update_compass(off, TrueHeadingSample(off_s + number * interval_s, 3.0, 3.0, 0), 1.0)
    assert is_jumping(off)


def frozen(watch):
    return is_frozen(watch.state.compasses[0], watch.t_s, watch.frozen_s, TIMEOUT_S)


def frozen_in_a_turn():
    """Return two compasses of which A was constant while the boat turned, as the rudder shows."""
    watch = Watch()
    watch.run(20.0)
    watch.run(1.0, a="frozen")
    watch.state = mark_contradicted(watch.state)
    return watch


def test_a_compass_that_froze_in_a_turn_is_not_used_until_its_number_changes():
    watch = frozen_in_a_turn()
    assert watch.run(1.0, a="frozen", b=0.0) is Source.COMPASS_B
    assert frozen(watch)
    watch.run(0.1, b=0.0)
    assert not frozen(watch)


@pytest.mark.parametrize("b", [None, 0.0, "frozen"])
def test_a_constant_number_without_a_turn_is_no_fault(b):
    watch = Watch()
    assert watch.run(20.0 * FROZEN_S, a="frozen", b=b) is Source.COMPASS_A
    assert not frozen(watch)
    assert len(watch.texts) == 1


def turn(watch, rate_deg_s, seconds):
    """Compass A is in use and constant, and so is the estimate; B turns."""
    for tick in range(round(seconds)):
        watch.run(1.0, a="frozen", b=radians(rate_deg_s) * (tick + 0.5))


@pytest.mark.parametrize("rate_deg_s", [0.5, 2.0])
def test_a_constant_compass_while_the_other_turns_is_frozen(rate_deg_s):
    watch = Watch()
    watch.run(10.0, a="frozen", b=0.0)
    turn(watch, rate_deg_s, 60.0)
    assert frozen(watch)


@pytest.mark.parametrize("off_deg", [5.0, 90.0, 170.0])
def test_another_compass_that_is_off_or_jumps_contradicts_no_constant_one(off_deg):
    watch = Watch()
    watch.run(10.0, a="frozen", b=0.0)
    assert watch.run(3.0 * FROZEN_S, a="frozen", b=radians(off_deg)) is Source.COMPASS_A
    assert not frozen(watch)


@pytest.mark.parametrize(("period_s", "steps", "waves"), [(0.6, 3.5, True), (0.6, 2.5, False), (30.0, 20.0, False)])
def test_a_compass_that_oscillated_and_is_constant_is_frozen(period_s, steps, waves):
    """Swings of fewer steps, and rare ones as of a boat that turns, do not count."""
    watch, step_rad = Watch(), radians(0.5)
    for tick in range(600):
        off_rad = step_rad * round(0.5 * steps * math.sin(2.0 * math.pi * tick / (10.0 * period_s)) + 0.25)
        watch.state = add_sample(watch.state, TrueHeadingSample(0.1 * tick, 1.0 + off_rad, 1.0 + off_rad, 0), 1.0)
    watch.t_s = 60.0
    watch.run(FROZEN_S - 1.0, a="frozen")
    assert not frozen(watch)
    watch.run(2.0, a="frozen")
    assert frozen(watch) is waves


@pytest.mark.parametrize(
    ("reading", "standing_s"),
    [
        (((0.1, 1),), 2.0),  # initially
        (((5.0, 2),), 10.0),
        (((5.0, 2), (0.5, 1200)), 10.0 * math.exp(-1.0)),  # decays in 10 minutes
        (((0.5, 1200),), 1.5),  # lower limit
    ],
)
def test_a_compass_stands_still_after_twice_the_longest_time_with_one_number(reading, standing_s):
    state, t_s, number = CompassState(sound_since_s=0.0), 0.0, 0
    for interval_s, count in reading:
        for _ in range(count):
            t_s, number = t_s + interval_s, number + 1
            state = update_compass(state, TrueHeadingSample(t_s, 1.0, 0.01 * (number % 2), 0), 1.0)
    for part in (0.5, 1.0):
        sample = TrueHeadingSample(t_s + part * standing_s, 1.0, state.raw_rad, 0)
        assert standstill_ratio(update_compass(state, sample, 1.0)) == pytest.approx(part, rel=0.01)


def test_each_reversal_of_a_compass_is_a_swing_with_a_memory_of_20_s():
    state, swings = CompassState(), []
    for number, t_s in enumerate((0.00, 0.01, 0.02, 0.03, 20.03)):
        raw_rad = 1.0 - radians(20.0) * (number % 2)
        state = update_compass(state, TrueHeadingSample(t_s, raw_rad, raw_rad, 0), 1.0)
        swings.append(state.turns.swings)
    assert swings == pytest.approx([0.0, 0.0, 1.0, 2.0, 1.0 + 2.0 * math.exp(-1.0)], abs=0.01)


def test_a_turn_of_less_than_a_few_steps_contradicts_no_coarse_compass():
    watch = Watch()
    steps = (0.0, radians(10.0), 0.0)  # without smaller ones
    for off_rad in steps:
        watch.state = add_sample(watch.state, TrueHeadingSample(watch.t_s, 1.0 + off_rad, 1.0 + off_rad, 0), 1.0)
    watch.run(2.0, a="frozen", b=0.0)
    coarse = watch.state.compasses[0]
    assert coarse.turns.resolution_rad == pytest.approx(radians(5.0))  # no compass is coarser
    watch.run(FROZEN_S, a="frozen", b=0.0)
    watch.run(30.0, a="frozen", b=radians(14.0))
    assert not frozen(watch)


@pytest.mark.parametrize("resolution_deg", [0.1, 1.0, 2.0])
def test_the_resolution_of_a_compass_is_learned(resolution_deg):
    state, rng = CompassState(), random.Random(1)
    for number in range(100):
        raw_rad = radians(resolution_deg) * round(rng.uniform(-3.0, 3.0) / resolution_deg) % (2.0 * math.pi)
        state = update_compass(state, TrueHeadingSample(0.1 * number, raw_rad, raw_rad, 0), 0.0)
    assert state.turns.resolution_rad == pytest.approx(radians(resolution_deg))


def test_a_compass_that_recovers_with_the_same_number_is_not_frozen():
    """As one that is switched off for a night: a silence is no standstill."""
    watch = Watch()
    watch.run(20.0)
    watch.run(0.1, a="frozen")
    assert watch.run(2.0 * FROZEN_S, a=None) is Source.NONE
    assert watch.run(0.1, a="frozen") is Source.COMPASS_A
    assert not frozen(watch)


def test_a_frozen_compass_stays_frozen_after_a_silence():
    watch = frozen_in_a_turn()
    watch.run(5.0, a="frozen")
    watch.run(5.0, a=None)
    assert watch.run(0.1, a="frozen") is Source.NONE
    assert frozen(watch)


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
def test_the_difference_is_the_mean_of_all_samples_at_first_and_of_10_s_later(before_s, after_s, share):
    """The offset of a new source is this difference, so its noise has to be small."""
    state = CompassState(sound_since_s=0.0)
    for tick in range(1, round(10 * (before_s + after_s)) + 1):
        off_rad = 0.1 if tick <= 10 * before_s else 0.0
        state = update_compass(state, TrueHeadingSample(0.1 * tick, 1.0 + off_rad, 0.01 * tick, 0), 1.0)
    assert state.difference_rad == pytest.approx(0.1 * share, rel=0.02)


def differing(seconds, off_rad, state=CompassState(sound_since_s=0.0), begin_s=0.0, expected=1.0):  # noqa: B008 - frozen
    """Return a compass that differs by off_rad from the estimate for some seconds, at 10 Hz."""
    for tick in range(1, round(10 * seconds) + 1):
        sample = TrueHeadingSample(begin_s + 0.1 * tick, 1.0 + off_rad, off_rad + 0.01 * (tick % 7), 0)
        state = update_compass(state, sample, expected)
    return state


def test_differences_before_the_compass_is_sound_do_not_count():
    unsound = differing(20.0, 0.3, CompassState())
    assert differing(0.1, 0.1, unsound, begin_s=20.0).difference_rad == pytest.approx(0.1)


def test_agreement_is_judged_by_the_difference_before_a_jump():
    assert differing(60.0, radians(14.0)).agreed
    assert not differing(60.0, radians(16.0)).agreed
    for off_deg, agrees in ((14.0, True), (16.0, False)):
        assert differing(30.0, radians(90.0), differing(60.0, radians(off_deg)), begin_s=60.0).agreed is agrees


def test_a_source_is_judged_with_the_offset_that_it_started_with():
    offset = CompassState(t_s=0.0, sound_since_s=0.0, offset_rad=radians(-40.0))
    followed = differing(5.0, radians(40.0), offset)
    assert (followed.near_s, followed.agreed) == (pytest.approx(5.0), True)
    assert differing(5.0, radians(-40.0), offset).near_s < 1.5


def test_without_an_estimate_there_is_no_difference():
    state = differing(5.0, 0.3, expected=math.nan)
    assert (state.difference_rad, state.agreed) == (0.0, False)
    assert math.isnan(state.steady_rad)
    assert state.near_s == pytest.approx(5.0)
