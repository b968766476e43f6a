"""Reports of a lost rudder blade and of a reversed servo direction: their times, and no false ones.

The proofs simulate with the compiled twin: `pytest -m proof tests/voyages/test_steering_lost.py`.
"""

import itertools
import math
import random

import numpy as np
import pytest
from msgspec.structs import replace

from firmware_py.common.intents import Arm, SetMode, SteerHeading
from firmware_py.common.mode_table import Mode
from firmware_py.faults.table import TABLE, Fault
from hil.lab.twin import loop
from hil.lab.twin.sea import GRID_S, speed_of
from hil.ship.scenarios import parse_scenario
from support import rig, voyage
from support.mismatched_ship import mismatched_hull

SEAS = ("tank", "sea", "swell", "weak")
OCEANS = ("ocean-1", "ocean-2", "ocean-3", "ocean-4")
REPORT = TABLE[Fault.STEERING_LOST].text
REPORT_REVERSED = TABLE[Fault.STEERING_REVERSED].text
ARMED_S = 180.0  # time limit of the report of a wrong servo direction
STEERAGE_M_S = 0.1  # at a lower speed the rudder has little effect: K is at most a quarter of the model's
OVER_RAD = math.radians(10.0)  # minimum rudder angle from the trim that counts as rudder work


def sailing(name, seed, **how):
    return rig.Sailing(rig.sea(name), seed, hull=mismatched_hull(**how)).get_under_way(Mode.GUIDED)


def random_turns(seed, hours, leg_s=300.0):
    """Return goals with a turn of 60 to 180 degrees every leg_s."""
    numbers, goal_rad, goals = random.Random(seed), 0.0, []
    for leg in range(round(hours * 3600.0 / leg_s)):
        goal_rad += numbers.choice((-1.0, 1.0)) * math.radians(numbers.uniform(60.0, 180.0))
        goals.append((leg * leg_s, goal_rad))
    return goals


def simulate_turns(name, seed, hours, leg_s=300.0):
    """Simulate random turns; return their number and the times of the first reports of each fault."""
    goals = random_turns(seed, hours, leg_s)
    ticks, _ = voyage.sail(name, seed, goals, hours * 3600.0)
    lost_s, reversed_s = voyage.loss_and_reversal_times(ticks)
    return len(goals), [*lost_s[:1], *reversed_s[:1]]


def rudder_work_to_report(name, seed, turn_deg, after_s=5.0, limit_s=400.0):
    """Lose the blade after_s into a turn; return the seconds of rudder work until the report, None without one."""
    boat = sailing(name, seed)
    boat.tick(SteerHeading(0.0))
    boat.run(240.0)
    straight_rad = math.radians(rig.sea(name).bias_deg)
    boat.tick(SteerHeading(math.radians(turn_deg)))
    boat.run(after_s)
    assert not boat.times_of(REPORT)
    boat.hull.grip, work_s = 0.0, 0.0
    for _ in range(round(10.0 * limit_s)):
        boat.tick()
        work_s += rig.STEP_S * (abs(boat.rudder_rad - straight_rad) > OVER_RAD)
        assert not boat.times_of(REPORT_REVERSED)
        if boat.times_of(REPORT):
            return work_s
    return None


def test_blade_lost_at_start_of_turn_is_reported():
    """In the tank, with a low speed estimate, this once was not reported within three minutes."""
    assert rudder_work_to_report("tank", 1, 120.0, after_s=0.0, limit_s=90.0) <= 60.0


@pytest.mark.proof
def test_oscillation_by_delay_is_not_reported():
    """Three times the lag and a delay of 8 s once caused a report at 213 s, in the third period."""
    boat = sailing("calm", 1, lag=3.0, delay_s=8.0)
    boat.run(50.0)
    boat.tick(SteerHeading(math.radians(60.0)))
    assert boat.run(250.0).times_of(REPORT) == []


@pytest.mark.parametrize("how", [{"delay_s": 12.0}, {"ability": 1.0 / 3.0, "lag": 3.0, "delay_s": 5.0}])
def test_turn_delay_is_not_reported(how):
    boat = sailing("calm", 1, **how)
    boat.run(50.0)
    boat.tick(SteerHeading(math.radians(60.0)))
    assert boat.run(60.0).times_of(REPORT) == []


def report_times(name, seed, turn_deg, after_s=5.0, limit_s=400.0):
    """Do the same with the compiled loop; return the rudder work and the time until the report [s]."""
    turn_s, straight_rad = 240.0, math.radians(rig.sea(name).bias_deg)
    goals = [(0.0, 0.0), (turn_s, math.radians(turn_deg))]
    lost_blade_s = turn_s + after_s
    ticks, _ = voyage.sail(name, seed, goals, lost_blade_s + limit_s, blade_lost_s=lost_blade_s)
    lost_s, reversed_s = voyage.loss_and_reversal_times(ticks)
    report_s = lost_s[0] if lost_s.size else math.inf
    assert lost_blade_s < report_s < min([*reversed_s[:1], math.inf])
    worked = (ticks[:, loop.TICK_S] > lost_blade_s) & (ticks[:, loop.TICK_S] <= report_s)
    work_s = rig.STEP_S * int(np.sum(np.abs(ticks[worked, loop.MEASURED_RAD] - straight_rad) > OVER_RAD))
    return work_s, report_s - lost_blade_s


@pytest.mark.proof
@pytest.mark.parametrize(("seed", "turn_deg"), [(8, -71.0), (17, -72.0)])
def test_lost_blade_is_reported_with_wind_and_trim_toward_goal(seed, turn_deg):
    """The reports once came after 123 and 136 s of rudder work, when the rudder had changed sides."""
    work_s, _ = report_times("sea", seed, turn_deg)
    assert work_s <= 60.0


def reversal_report_s(name, seed, turn_deg):
    """Arm a boat with a wrong RUD_REVERSE; return the time to the report, None if it is not within ARMED_S."""
    boat = rig.Sailing(rig.sea(name), seed, hull=rig.FineHull, RUD_REVERSE=1).get_under_way(Mode.GUIDED)
    armed_s, before = boat.t_s, boat.state.parameters
    boat.tick(SteerHeading(boat.snapshot.heading_rad + math.radians(turn_deg)))
    boat.run(ARMED_S, until=lambda boat: boat.times_of(REPORT_REVERSED))
    assert boat.state.parameters == before
    return boat.t_s - armed_s if boat.times_of(REPORT_REVERSED) else None


@pytest.mark.parametrize(("name", "seed"), [("sea", 2), ("swell", 1)])
def test_reversed_servo_is_reported(name, seed):
    """In the scenario sea the estimate of this seed attributes the turn to waves."""
    assert reversal_report_s(name, seed, 0.0) is not None


def heading_errors_deg(ticks, record):
    """Return the heading error at each tick [deg], not wrapped to half a turn."""
    true_rad = np.interp(ticks[:, loop.TICK_S], 0.1 * np.arange(record.heading_rad.size), record.heading_rad)
    errors = np.degrees(np.unwrap(ticks[:, loop.HEADING_RAD]) - true_rad)
    return errors - 360.0 * np.round(errors[50] / 360.0)


def slow_time_s(name, seed, until_s):
    """Return the time before until_s with less than steerage speed, in a sea with varying speed."""
    scenario = parse_scenario(name)
    part, _ = speed_of(scenario, seed, round(until_s / GRID_S))
    if not part.size:
        return 0.0
    shares = np.zeros(part.size)
    part.fill(shares)
    return GRID_S * int(np.sum(scenario.speed_m_s * shares < STEERAGE_M_S))


@pytest.mark.proof
@pytest.mark.parametrize("name", [*SEAS, "storm", "gusts", *OCEANS])
def test_reversed_servo_is_reported_within_three_minutes(name, figures):
    """Only time with steerage speed counts; without a reaction, the heading error stays below half a turn."""
    parameters, report_s, armed_s, error_deg = voyage.parameters_with(RUD_REVERSE=1), [], [], []
    with_speed_s = []
    for seed, turn_deg in itertools.product(range(1, 11), (0.0, 60.0)):
        ticks, record = voyage.sail(name, seed, [(0.0, math.radians(turn_deg))], 600.0, parameters=parameters)
        _, reversed_s = voyage.loss_and_reversal_times(ticks)
        # There is no evidence until the rudder moves.
        over_s = ticks[np.abs(ticks[:, loop.COMMAND_RAD]) > OVER_RAD, loop.TICK_S]
        report_s.append(reversed_s[0] - over_s[0] if reversed_s.size else math.inf)
        steered_s = ticks[np.isfinite(ticks[:, loop.ERROR_RAD]), loop.TICK_S]
        armed_s.append(reversed_s[0] - steered_s[0] if reversed_s.size else math.inf)
        with_speed_s.append(armed_s[-1] - slow_time_s(name, seed, min(armed_s[-1], 600.0)))
        error_deg.append(np.abs(heading_errors_deg(ticks, record)).max())
    figures.keep(f"steering_reversed_reported_median_{name}", float(np.median(report_s)), "s")
    figures.keep(f"steering_reversed_reported_worst_{name}", max(report_s), "s")
    figures.keep(f"steering_reversed_armed_worst_{name}", max(armed_s), "s")
    figures.keep(f"steering_reversed_with_way_worst_{name}", max(with_speed_s), "s")
    figures.keep(f"steering_reversed_astray_{name}", max(error_deg), "deg")
    assert max(with_speed_s) <= ARMED_S
    assert max(error_deg) < 180.0


@pytest.mark.proof
@pytest.mark.parametrize("name", SEAS)
def test_no_false_report_in_fifty_seeds(name, figures):
    runs = [simulate_turns(name, seed, hours=0.5) for seed in range(1, 51)]
    turns, false = sum(legs for legs, _ in runs), sum(len(reports) for _, reports in runs)
    figures.keep(f"steering_lost_turns_{name}", turns, "turns")
    figures.keep(f"steering_lost_false_{name}", false, "alarms")
    assert false == 0


@pytest.mark.proof
@pytest.mark.parametrize("name", [*SEAS, "storm", "gusts", "surge", *OCEANS])
def test_no_report_in_a_day_of_turns(name):
    assert simulate_turns(name, 99, hours=24.0, leg_s=900.0)[1] == []


@pytest.mark.proof
@pytest.mark.parametrize("name", SEAS)
def test_lost_blade_is_reported_after_about_a_minute_of_rudder_work(name, figures):
    turns = random.Random(7)
    turns_deg = [turns.choice((-1, 1)) * turns.uniform(60.0, 180.0) for _ in range(20)]
    times = [report_times(name, seed, turn_deg) for seed, turn_deg in enumerate(turns_deg, 1)]
    work_times_s, elapsed_times_s = [work_s for work_s, _ in times], [clock_s for _, clock_s in times]
    figures.keep(f"steering_lost_reported_median_{name}", float(np.median(work_times_s)), "s")
    figures.keep(f"steering_lost_reported_worst_{name}", max(work_times_s), "s")
    figures.keep(f"steering_lost_clock_worst_{name}", max(elapsed_times_s), "s")
    figures.keep(f"steering_lost_within_60_{name}", sum(work_s <= 60.0 for work_s in work_times_s), "of 20")
    # At 0.2 m/s wind and trim may turn the boat as a working rudder does: one report took 71 s.
    assert sum(work_s <= 60.0 for work_s in work_times_s) >= (19 if name == "weak" else 20)
    # The firmware, with the servo and the compass of the rig.
    firmware_work_s = [rudder_work_to_report(name, seed, turn_deg) for seed, turn_deg in enumerate(turns_deg[:3], 1)]
    assert None not in firmware_work_s


def test_silent_servo_is_no_lost_blade(monkeypatch):
    """The rudder angle is unknown then, so the response to it is not known either."""
    inputs = rig.Inputs

    def unanswered(*parts, **more):
        return replace(inputs(*parts, **more), rudder=())

    monkeypatch.setattr(rig, "Inputs", unanswered)
    boat = rig.Sailing(rig.sea("tank"), 1, hull=mismatched_hull())
    boat.hull.grip = 0.0
    boat.run(1.5)
    boat.tick(Arm(armed=True, force=True), SetMode(Mode.GUIDED), SteerHeading(math.radians(90.0)))
    assert boat.run(120.0).times_of(TABLE[Fault.RUDDER_SILENT].text)
    assert abs(boat.target_rad) > OVER_RAD
    assert boat.times_of(REPORT) == []
