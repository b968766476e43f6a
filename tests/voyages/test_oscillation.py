"""Heading oscillations caused by a model mismatch are detected, and the gain is reduced until they end."""

import math
from functools import cache
from itertools import groupby, pairwise

import numpy as np
import pytest

from firmware_py.common.intents import SteerHeading
from firmware_py.common.mode_table import Mode
from firmware_py.faults.table import TABLE, Fault
from firmware_py.safety.oscillation import HOLD_S, REDUCTION_STEP
from hil.lab.twin import loop
from hil.report.figure_file import key_of
from support import rig, voyage
from support.mismatched_ship import mismatched_hull

ROW = TABLE[Fault.HELM_OSCILLATES]
TURN_S = 60.0
# Mismatches that make the heading oscillate. A lag of three times or a quarter of the model's does not.
CAUSES = {
    "delay 12 s": {"delay_s": 12.0},
    "three times the lag, delay 8 s": {"lag": 3.0, "delay_s": 8.0},
    "slow float": {"float_dynamics": (0.12, 0.3)},
    "slow float, delay 2 s": {"float_dynamics": (0.1, 0.4), "delay_s": 2.0},
    "ten times the lag": {"lag": 10.0},
}


def known_shortfall(*case):
    """Return a case that the autopilot does not pass; the last argument is the measured value."""
    *values, reason = case
    return pytest.param(*values, marks=pytest.mark.xfail(strict=True, reason=reason))


def run_turn(mismatch, seconds, name="calm", seed=1):
    """Turn by 60 deg after a minute; return the boat, and heading error and rudder [deg] at each second after that."""
    boat = rig.Sailing(rig.sea(name), seed, hull=mismatched_hull(**mismatch)).get_under_way(Mode.GUIDED)
    boat.run(TURN_S - boat.t_s)
    boat.tick(SteerHeading(math.radians(60.0)))
    samples = []
    while boat.t_s < seconds:
        boat.run(1.0)
        samples.append((math.degrees(boat.hull.plant.heading_rad) - 60.0, math.degrees(boat.rudder_rad)))
    return boat, np.array(samples)


@cache
def run_turn_with(cause):
    return run_turn(CAUSES[cause], 1200.0)


def spread(samples, from_s, to_s):
    """Return the standard deviations of heading and rudder [deg] between two times after the turn."""
    samples_between = samples[max(int(from_s - TURN_S), 0) : int(to_s - TURN_S)]
    return samples_between.std(axis=0)


def first_oscillation(samples):
    """Return the start of an oscillation of 5 deg and more beyond the goal, and its period [s]."""
    sides = np.sign(samples[:, 0])
    changes = np.flatnonzero(np.diff(sides)) + 1
    for begin, end in pairwise(changes):
        if np.abs(samples[begin:end, 0]).max() > 5.0:
            return TURN_S + begin, 2.0 * float(end - begin)
    raise AssertionError("no oscillation")


def test_gain_reduction_ends_an_oscillation():
    boat, samples = run_turn(CAUSES["three times the lag, delay 8 s"], 450.0)
    assert boat.times_of(ROW.text)
    first_s = boat.times_of(ROW.text)[0]
    assert 0.0 < boat.times_of(ROW.recovery)[-1] - first_s < 180.0
    assert spread(samples, first_s + 120.0, first_s + 180.0)[1] < 0.2 * spread(samples, first_s - 60.0, first_s)[1]
    # A rudder bias estimated during the oscillation once kept the boat 12 deg off its goal for ten minutes.
    assert np.abs(samples[-100:, 0]).max() < 6.0
    assert boat.snapshot.gain_reduction == REDUCTION_STEP


@pytest.mark.proof
@pytest.mark.parametrize("cause", CAUSES)
def test_oscillations_are_detected_in_time(cause, figures):
    boat, samples = run_turn_with(cause)
    (start_s, period_s), first_s = first_oscillation(samples), boat.times_of(ROW.text)[0]
    print(cause, f"period {period_s:.0f} s, detected after {first_s - start_s:.0f} s")
    figures.keep(key_of("oscillation", "period", cause), period_s, "s")
    figures.keep(key_of("oscillation", "recognised", cause), first_s - start_s, "s")
    # Detection needs a half period and a part of the next.
    assert first_s - start_s <= max(60.0, 0.8 * period_s)


@pytest.mark.proof
@pytest.mark.parametrize("cause", [*list(CAUSES)[:-1], known_shortfall("ten times the lag", "327 s: two oscillations")])
def test_oscillations_are_ended(cause, figures):
    boat, samples = run_turn_with(cause)
    first_s = boat.times_of(ROW.text)[0]
    recovery_s = boat.times_of(ROW.recovery)[-1] - first_s
    print(cause, f"ended after {recovery_s:.0f} s")
    figures.keep(key_of("oscillation", "gone", cause), recovery_s, "s")
    assert recovery_s <= 180.0
    assert not boat.snapshot.faults >> Fault.HELM_OSCILLATES & 1
    assert spread(samples, 1000.0, 1200.0)[1] < 0.5 * spread(samples, first_s - 90.0, first_s)[1]
    assert spread(samples, 1000.0, 1200.0)[0] < 1.0
    # A rudder bias estimated during the oscillation once kept the boat 8 deg off its goal.
    assert abs(samples[-200:, 0].mean()) < 2.0


@pytest.mark.proof
@pytest.mark.parametrize(
    ("mismatch", "name"),
    [
        *(
            (mismatch, name)
            for mismatch in ({"lag": 3.0}, {"ability": 4.0}, {"delay_s": 5.0})
            for name in ("calm", "tank")
        ),
        ({"ability": 1.0 / 3.0, "lag": 3.0}, "calm"),
        known_shortfall({"ability": 1.0 / 3.0, "lag": 3.0}, "tank", "2.1 deg"),
    ],
)
def test_no_limit_cycle_with_a_model_mismatch_in_flat_water(name, mismatch):
    _, samples = run_turn(mismatch, 900.0, name)
    assert spread(samples, 600.0, 900.0)[0] < 1.0


def run_detector(text, seed, goals, seconds):
    """Simulate with the twin; return the detector state at each tick, and the final gain reduction."""
    ticks, _ = voyage.sail(text, seed, goals, seconds)
    return ticks[:, loop.OSCILLATING] > 0.0, ticks[-1, loop.GAIN_REDUCTION]


def detection_and_recovery_s(sea, seed):
    """Turn a ship with three times the lag and a delay of 8 s; return the detection time and the recovery time [s].

    The detection time counts from the start of the first half period with a heading error of 5 deg or more, and is
    negative if the report comes earlier. Both are NaN if there is no such half period within ten minutes.
    """
    turn_s, goal_rad = 120.0, math.radians(60.0 if seed % 2 else -90.0)
    ticks, _ = voyage.sail(f"{sea}+kt=1:3,delay=8", seed, [(0.0, 0.0), (turn_s, goal_rad)], 900.0)
    after = ticks[ticks[:, loop.TICK_S] > turn_s + 1.0]
    now_s, beyond_deg = after[:, loop.TICK_S], np.degrees(after[:, loop.ERROR_RAD]) * np.sign(goal_rad)
    changes = np.append(np.flatnonzero(np.diff(np.sign(beyond_deg))) + 1, now_s.size)
    peaks = [np.abs(beyond_deg[begin:end]).max() for begin, end in pairwise(changes)]
    large_s = [now_s[begin] for begin, peak in zip(changes, peaks, strict=False) if peak >= 5.0]
    if not large_s or large_s[0] > turn_s + 600.0:
        return math.nan, math.nan
    transition = np.diff((ticks[:, loop.OSCILLATING] > 0.0).astype(int))
    report_s, recovered_s = ticks[1:, loop.TICK_S][transition > 0], ticks[1:, loop.TICK_S][transition < 0]
    return (report_s[0] - large_s[0], recovered_s[-1] - report_s[-1]) if report_s.size else (math.inf, math.inf)


@pytest.mark.proof
@pytest.mark.parametrize(
    "sea", ["calm", known_shortfall("tank", "131 s with a small oscillation; 18 of 20 within a minute")]
)
def test_oscillation_is_reported_within_a_minute_and_ends_within_three(sea, figures):
    times_s = np.array([detection_and_recovery_s(sea, seed) for seed in range(1, 21)])
    print(sea, np.round(times_s).tolist())
    figures.keep(f"oscillation_swung_{sea}", int(np.sum(times_s[:, 0] == times_s[:, 0])), "of 20")
    figures.keep(f"oscillation_reported_worst_{sea}", float(np.nanmax(times_s[:, 0])), "s")
    figures.keep(f"oscillation_gone_worst_{sea}", float(np.nanmax(times_s[:, 1])), "s")
    assert np.isfinite(times_s[:, 0]).sum() >= 12
    assert np.nanmax(times_s[:, 0]) <= 60.0
    assert np.nanmax(times_s[:, 1]) <= 180.0


@pytest.mark.proof
@pytest.mark.parametrize(
    "ship",
    [
        known_shortfall("delay=12", "13 deg overshoot"),
        known_shortfall("kt=1:3,delay=8", "11 deg overshoot"),
        known_shortfall("float=0.1:0.4,delay=2", "28 deg overshoot"),
    ],
)
def test_with_a_reduced_gain_a_turn_of_150_deg_takes_less_than_four_minutes(ship, figures):
    """The turn has no overshoot. With the feedforward divided by the gain reduction it took 360 to 530 s."""
    turn_s, goals = 850.0, [(0.0, 0.0), (200.0, math.radians(60.0)), (850.0, math.radians(-90.0))]
    ticks, _ = voyage.sail(f"calm+{ship}", 1, goals, 1500.0)
    assert ticks[ticks[:, loop.TICK_S] < turn_s, loop.GAIN_REDUCTION][-1] > 7.0
    after = ticks[ticks[:, loop.TICK_S] > turn_s + 1.0]
    error_deg = np.degrees(after[:, loop.ERROR_RAD])
    arrival_s = float(after[np.argmax(error_deg > -5.0), loop.TICK_S] - turn_s)
    print(ship, f"turned in {arrival_s:.0f} s, overshoot {error_deg.max():.1f} deg")
    figures.keep(key_of("oscillation", ship, "turned_reduced"), arrival_s, "s")
    assert arrival_s < 220.0
    assert error_deg.max() < 8.0
    assert not after[:, loop.OSCILLATING].any()


@pytest.mark.proof
@pytest.mark.parametrize("sea", ["sea", "swell"])
def test_turn_delay_is_detected_in_waves(sea):
    """Regression at 0.7 and 0.9 m/s: an upper limit of 16 model lags once excluded the period of 35 s."""
    is_oscillating, gain_reduction = run_detector(
        f"{sea}+kt=1:3,delay=8", 1, [(0.0, 0.0), (60.0, math.radians(60.0))], 600.0
    )
    assert is_oscillating.any()
    assert rig.STEP_S * np.sum(is_oscillating) < 180.0
    assert not is_oscillating[-1]
    assert gain_reduction > 1.0


@pytest.mark.proof
@pytest.mark.parametrize(
    "name",
    ["calm", "tank", "sea", "swell", "weak", "storm", "gusts", "surge", "ocean-1", "ocean-2", "ocean-3", "ocean-4"],
)
def test_no_false_oscillation(name):
    goals = [(900.0 * leg, math.radians(100.0 * leg)) for leg in range(96)]
    assert not run_detector(name, 1, goals, 86400.0)[0].any()


@pytest.mark.proof
@pytest.mark.xfail(strict=True, reason="pauses of 873 and 1339 s")
def test_each_gain_reduction_lasts_longer():
    """In calm water only the turns, one each 20 min, cause an oscillation."""
    hull = mismatched_hull(**CAUSES["ten times the lag"])
    boat = rig.Sailing(rig.sea("calm"), 1, hull=hull).get_under_way(Mode.GUIDED)
    is_reduced = []
    for turn in range(15):
        boat.tick(SteerHeading(math.radians(100.0 * turn % 360.0)))
        boat.run(1200.0)
        is_reduced.append(boat.snapshot.gain_reduction >= REDUCTION_STEP)
    pauses_s = np.diff(boat.times_of(ROW.text))
    assert pauses_s[-1] > pauses_s[0] + 900.0
    assert boat.state.supervisor.oscillation.hold_s >= 8.0 * HOLD_S
    assert [len(list(turns)) for reduced, turns in groupby(is_reduced) if reduced] == [1, 2, 4]
