"""A compass that repeats one number while the boat turns, found by the estimate of a boat at sea."""

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


def under_way(name, seed=1, resolution_deg=0.1, noise_deg=0.3, **parameters):
    """Return a boat that has steered north for two minutes."""
    boat = rig.Sailing(rig.sea(name), seed, hull=rig.FineHull, **parameters)
    boat.resolution_rad, boat.noise_rad = radians(resolution_deg), radians(noise_deg)
    boat.under_way(Mode.GUIDED).tick(SteerHeading(0.0))
    return boat.run(120.0)


@pytest.fixture
def freeze(monkeypatch):
    """Freeze the compass of a boat, and let it measure again."""

    def frozen(boat, still):
        stands_rad = compass_of(boat).raw_rad
        as_it_is = lambda t_s, _heading_rad, north: HeadingSample(t_s, stands_rad, north)  # noqa: E731
        monkeypatch.setattr(rig, "HeadingSample", as_it_is if still else HeadingSample)

    return frozen


def compass_of(boat):
    return boat.state.heading_estimator.tick.sources.compasses[0]


def off_deg(boat):
    """How far the estimated heading is from the true one."""
    return math.degrees(abs(wrap_pi(boat.state.heading_estimator.heading.heading_rad - boat.hull.heading_low_rad(0.0))))


@pytest.mark.parametrize(("turn_deg", "seed"), [(40.0, 1), pytest.param(-120.0, 2, marks=pytest.mark.proof)])
def test_a_compass_that_freezes_in_a_turn_is_reported_early_and_not_followed(freeze, turn_deg, seed):
    boat = under_way("tank", seed)
    for leg_deg in (120.0, -120.0, 0.0):  # a turn separates speed and current, so that the course gives a heading
        boat.tick(SteerHeading(radians(leg_deg)))
        boat.run(90.0)
    boat.tick(SteerHeading(radians(turn_deg)))
    freeze(boat.run(4.0), still=True)
    begun_s = boat.t_s
    boat.run(20.0, until=lambda boat: boat.times_of(FAULT_TEXT))
    assert boat.t_s - begun_s < 15.0
    assert boat.state.heading_estimator.tick.sources.in_use == Source.COURSE
    assert off_deg(boat) < 5.0
    boat.run(100.0)
    assert abs(math.degrees(wrap_pi(boat.hull.heading_low_rad(0.0) - radians(turn_deg)))) < 12.0
    assert boat.times_of("Compass heading jumped") == []
    freeze(boat, still=False)
    boat.run(20.0)
    assert len(boat.times_of(FAULT_TEXT)) == len(boat.times_of(RECOVERY_TEXT)) == 1
    assert boat.times_of("No valid heading") == []  # not for a tick
    assert boat.state.heading_estimator.tick.sources.in_use == Source.COMPASS_A


@pytest.mark.parametrize(("resolution_deg", "noise_deg", "every"), [(1.0, 0.1, 10), (0.1, 0.0, 1)])
def test_a_coarse_compass_in_flat_water_is_sound_from_the_dock_on(monkeypatch, resolution_deg, noise_deg, every):
    """Without a receiver, so that there is no other heading: it can be armed, and steers."""
    boat = rig.Sailing(rig.sea("calm"), 1)
    boat.resolution_rad, boat.noise_rad = radians(resolution_deg), radians(noise_deg)
    monkeypatch.setattr(boat, "fixes", tuple)
    inputs = rig.Inputs
    rarely = lambda tick, headings, *more, **named: inputs(tick, () if tick.index % every else headings, *more, **named)  # noqa: E731
    monkeypatch.setattr(rig, "Inputs", rarely)
    boat.run(60.0)
    boat.tick(Arm(armed=True), SetMode(Mode.GUIDED))
    boat.tick(SteerHeading(radians(60.0)))
    assert boat.state.modes.armed
    boat.run(120.0)
    assert boat.times_of("Compass") == boat.times_of("Heading lost") == []
    assert math.degrees(boat.hull.heading_low_rad(0.0)) == pytest.approx(60.0, abs=3.0)


def turning(name, resolution_deg, noise_deg, legs, leg_s):
    """Sail turns; return the times of reports of the compass that only turns contradict, and its longest standstill."""
    boat, longest_s = under_way(name, 1, resolution_deg, noise_deg, CMP_FROZEN_S=3600.0), 0.0
    numbers = random.Random(legs)
    for _ in range(legs):
        boat.tick(SteerHeading(radians(numbers.uniform(0.0, 360.0))))
        for _ in range(round(10.0 * leg_s)):
            boat.tick()
            longest_s = max(longest_s, compass_of(boat).t_s - compass_of(boat).changed_s)
    return boat.times_of(FAULT_TEXT), longest_s


def test_a_coarse_compass_that_stands_still_in_a_calm_is_not_frozen():
    """From the start on, and through turns."""
    reported_s, longest_s = turning("calm", 1.0, 0.1, 2, 60.0)
    assert reported_s == []
    assert longest_s > 1.5  # it has shown one and the same number


@pytest.mark.proof
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("noise_deg", [0.3, 0.1, 0.02, 0.0])
@pytest.mark.parametrize("resolution_deg", [1.0, 0.1])
@pytest.mark.parametrize("name", ["calm", "tank"])
def test_a_coarse_compass_is_not_frozen_in_hours_of_turns(name, resolution_deg, noise_deg):
    """`pytest -m proof -s tests/unit/firmware_py/estimate/test_standstill.py`: two hours of each."""
    reported_s, longest_s = turning(name, resolution_deg, noise_deg, 24, 300.0)
    print(f"{name} {resolution_deg:g} deg, noise {noise_deg:g}: stood {longest_s:.1f} s at most")
    assert reported_s == []


def test_the_time_frozen_does_not_count_as_the_usual_standstill(freeze):
    boat = under_way("sea")
    freeze(boat, still=True)
    boat.run(40.0)
    assert boat.times_of(FAULT_TEXT)
    freeze(boat, still=False)
    assert compass_of(boat.run(20.0)).longest_s < 2.0
