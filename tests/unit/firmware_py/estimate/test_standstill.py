"""Detection of a compass whose number is constant while the boat turns, in a simulated sea."""

import math
import random

import pytest

from firmware_py.common.angles import radians, wrap_pi
from firmware_py.common.intents import Arm, SetMode, SteerHeading
from firmware_py.common.mode_table import Mode
from firmware_py.common.records import HeadingSample
from firmware_py.estimate.sources import Source
from firmware_py.faults.table import TABLE, Fault
from support import rig

FAULT_TEXT, RECOVERY_TEXT = TABLE[Fault.COMPASS_FROZEN].text, TABLE[Fault.COMPASS_FROZEN].recovery


def steer_north(name, seed=1, resolution_deg=0.1, noise_deg=0.3, **parameters):
    """Return a boat that has steered north for two minutes."""
    boat = rig.Sailing(rig.sea(name), seed, hull=rig.FineHull, **parameters)
    boat.resolution_rad, boat.noise_rad = radians(resolution_deg), radians(noise_deg)
    boat.get_under_way(Mode.GUIDED).tick(SteerHeading(0.0))
    return boat.run(120.0)


@pytest.fixture
def set_frozen(monkeypatch):
    """Return a function that freezes the compass of a boat, or lets it measure again."""

    def apply(boat, is_frozen):
        raw_rad = compass_of(boat).raw_rad
        constant = lambda t_s, _heading_rad, north: HeadingSample(t_s, raw_rad, north)  # noqa: E731
        monkeypatch.setattr(rig, "HeadingSample", constant if is_frozen else HeadingSample)

    return apply


def compass_of(boat):
    return boat.state.heading_estimator.tick.sources.compasses[0]


def error_deg(boat):
    """Return the error of the estimated heading [deg]."""
    return math.degrees(abs(wrap_pi(boat.state.heading_estimator.heading.heading_rad - boat.hull.heading_low_rad(0.0))))


@pytest.mark.parametrize(("turn_deg", "seed"), [(40.0, 1), pytest.param(-120.0, 2, marks=pytest.mark.proof)])
def test_compass_frozen_in_a_turn_is_reported_within_15_s_and_not_followed(set_frozen, turn_deg, seed):
    boat = steer_north("tank", seed)
    for leg_deg in (120.0, -120.0, 0.0):  # turns separate speed and current, so that the course gives a heading
        boat.tick(SteerHeading(radians(leg_deg)))
        boat.run(90.0)
    boat.tick(SteerHeading(radians(turn_deg)))
    set_frozen(boat.run(4.0), is_frozen=True)
    begun_s = boat.t_s
    boat.run(20.0, until=lambda boat: boat.times_of(FAULT_TEXT))
    assert boat.t_s - begun_s < 15.0
    assert boat.state.heading_estimator.tick.sources.in_use == Source.COURSE
    assert error_deg(boat) < 5.0
    boat.run(100.0)
    assert abs(math.degrees(wrap_pi(boat.hull.heading_low_rad(0.0) - radians(turn_deg)))) < 12.0
    assert boat.times_of("Compass heading jumped") == []
    set_frozen(boat, is_frozen=False)
    boat.run(20.0)
    assert len(boat.times_of(FAULT_TEXT)) == len(boat.times_of(RECOVERY_TEXT)) == 1
    assert boat.times_of("No valid heading") == []  # not even for a tick
    assert boat.state.heading_estimator.tick.sources.in_use == Source.COMPASS_A


@pytest.mark.parametrize(("resolution_deg", "noise_deg", "ticks"), [(1.0, 0.1, 10), (0.1, 0.0, 1)])
def test_coarse_compass_in_calm_water_is_sound_from_the_dock_on(monkeypatch, resolution_deg, noise_deg, ticks):
    """Without a receiver there is no other heading; the boat can be armed, and steers."""
    boat = rig.Sailing(rig.sea("calm"), 1)
    boat.resolution_rad, boat.noise_rad = radians(resolution_deg), radians(noise_deg)
    monkeypatch.setattr(boat, "fixes", tuple)
    inputs = rig.Inputs

    def with_rare_headings(tick, headings, *args, **kwargs):
        return inputs(tick, () if tick.index % ticks else headings, *args, **kwargs)

    monkeypatch.setattr(rig, "Inputs", with_rare_headings)
    boat.run(60.0)
    boat.tick(Arm(armed=True), SetMode(Mode.GUIDED))
    boat.tick(SteerHeading(radians(60.0)))
    assert boat.state.modes.armed
    boat.run(120.0)
    assert boat.times_of("Compass") == boat.times_of("Heading lost") == []
    assert math.degrees(boat.hull.heading_low_rad(0.0)) == pytest.approx(60.0, abs=3.0)


def sail_turns(name, resolution_deg, noise_deg, legs, leg_s):
    """Sail turns with a large CMP_FROZEN_S; return the times of the fault, and the longest time with one number."""
    boat, longest_s = steer_north(name, 1, resolution_deg, noise_deg, CMP_FROZEN_S=3600.0), 0.0
    rng = random.Random(legs)
    for _ in range(legs):
        boat.tick(SteerHeading(radians(rng.uniform(0.0, 360.0))))
        for _ in range(round(10.0 * leg_s)):
            boat.tick()
            longest_s = max(longest_s, compass_of(boat).t_s - compass_of(boat).changed_s)
    return boat.times_of(FAULT_TEXT), longest_s


def test_coarse_compass_with_a_constant_number_in_calm_water_is_not_frozen():
    reported_s, longest_s = sail_turns("calm", 1.0, 0.1, 2, 60.0)
    assert reported_s == []
    assert longest_s > 1.5  # the number has been constant


@pytest.mark.proof
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("noise_deg", [0.3, 0.1, 0.02, 0.0])
@pytest.mark.parametrize("resolution_deg", [1.0, 0.1])
@pytest.mark.parametrize("name", ["calm", "tank"])
def test_coarse_compass_is_not_frozen_in_hours_of_turns(name, resolution_deg, noise_deg):
    """Two hours of each; `-s` prints the longest times with one number."""
    reported_s, longest_s = sail_turns(name, resolution_deg, noise_deg, 24, 300.0)
    print(f"{name} {resolution_deg:g} deg, noise {noise_deg:g}: constant for at most {longest_s:.1f} s")
    assert reported_s == []


def test_time_while_frozen_does_not_raise_the_usual_standstill(set_frozen):
    boat = steer_north("sea")
    set_frozen(boat, is_frozen=True)
    boat.run(40.0)
    assert boat.times_of(FAULT_TEXT)
    set_frozen(boat, is_frozen=False)
    assert compass_of(boat.run(20.0)).longest_s < 2.0
