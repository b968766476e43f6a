"""A simulated boat in one process: tick, ship and sensors without ports, thousands of times faster than real time."""

import dataclasses
import functools
import math

import numpy as np
from msgspec.structs import replace

from firmware_py.common.angles import TWO_PI, radians
from firmware_py.common.intents import Arm, Request, SetMode
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderFeedback,
    Tick,
)
from firmware_py.core.state import State
from firmware_py.core.step import step
from firmware_py.model.kt import OCEAN_RAMBLER
from firmware_py.plans.items import Command
from hil.devices.nmea_gps import Gaps
from hil.ship.disturbances import NO_DISTURBANCES, Receiver
from hil.ship.drift import RudderDrift
from hil.ship.gusts import Gusts
from hil.ship.hull import Hull
from hil.ship.kt_plant import KtPlant
from hil.ship.noise import NormalNumbers, Stream, generator
from hil.ship.orbit import Orbit
from hil.ship.planar import PlanarMotion, Tide
from hil.ship.scenarios import Scenario, find_scenario
from hil.ship.waves import WaveYaw
from support.plans import item, mission, placed

UTC_S = 1_767_225_600.0
STEP_S = 0.1
SLEW_RAD_S = radians(30.0)
COUNT_RAD = TWO_PI / 4096.0
RESOLUTION_RAD, NOISE_RAD = radians(0.1), radians(0.3)  # of the compass
FIX_NOISE_M, FIX_MEMORY_S, VELOCITY_NOISE_M_S = 1.5, 60.0, 0.03  # the position error has this time constant
IDEAL_RECEIVER = Receiver(latency_s=0.0, lost=0.0, filter_s=0.0, noise_m_s=VELOCITY_NOISE_M_S)


class TickHull:
    """hil.ship.hull.Hull with the same parts and steps of one tick; test_rig.py compares both."""

    def __init__(self, scenario, seed):
        assert scenario.disturbances == NO_DISTURBANCES, "disturbances need FineHull"
        scaled = OCEAN_RAMBLER.at_speed(scenario.speed_m_s)
        bias_rad = scaled.rudder_offset_rad + radians(scenario.bias_deg)
        self.plant = KtPlant(scaled._replace(rudder_offset_rad=bias_rad), STEP_S)
        self.drift = RudderDrift(radians(scenario.drift_deg), STEP_S, NormalNumbers(generator(seed, Stream.DRIFT)))
        numbers = NormalNumbers(generator(seed, Stream.WAVES))
        self.waves = WaveYaw(radians(scenario.wave_yaw_deg), scenario.wave_period_s, STEP_S, numbers)
        self.gusts = Gusts(radians(scenario.gust_deg), STEP_S, generator(seed, Stream.GUSTS))
        along_rad, orbital = radians(scenario.waves_toward_deg), NormalNumbers(generator(seed, Stream.ORBIT))
        self.orbit = Orbit(scenario.orbital_m_s, scenario.wave_period_s, along_rad, STEP_S, orbital)
        direction_rad = radians(scenario.current_toward_deg)
        tide = Tide(scenario.current_m_s, direction_rad, scenario.tide_s, scenario.tide_rotary)
        self.track = PlanarMotion(scenario.speed_m_s, tide)
        self.t_s = 0.0
        self.rudder_rad = 0.0

    def step(self, rudder_rad):
        before_rad = self.plant.heading_rad
        self.plant.step(0.5 * (self.rudder_rad + rudder_rad), self.drift.angle_rad + self.gusts.angle_rad)
        self.track.step(0.5 * (before_rad + self.plant.heading_rad), self.t_s + 0.5 * STEP_S, STEP_S)
        self.drift.step()
        self.waves.step()
        self.gusts.step()
        self.orbit.step()
        self.rudder_rad = rudder_rad
        self.t_s += STEP_S

    def heading_low_rad(self, _offset_s):
        return self.plant.heading_rad

    def heading_rad(self, offset_s):
        return self.plant.heading_rad + self.waves.angle_rad(offset_s)

    def compass_heading_rad(self, offset_s):
        return self.heading_rad(offset_s)

    def velocity_m_s(self, _offset_s):
        return self.track.velocity_m_s(self.plant.heading_rad, self.t_s)

    def position_m(self, _offset_s):
        return self.track.north_m, self.track.east_m

    def velocity_in_waves_m_s(self, offset_s):
        return tuple(np.add(self.velocity_m_s(offset_s), self.orbit.velocity_m_s(offset_s)))

    def position_in_waves_m(self, offset_s):
        return tuple(np.add(self.position_m(offset_s), self.orbit.position_m(offset_s)))


class FineHull(Hull):
    """The hull with all disturbances, in five steps of its grid; the rudder moves linearly between ticks.

    `grip`: share of the rudder that acts; 0: the rudder is lost.
    """

    def __init__(self, scenario, seed):
        super().__init__(scenario, OCEAN_RAMBLER, seed)
        self.before_rad = 0.0  # rudder at the previous tick
        self.grip = 1.0  # effect of the rudder; 0: the blade is lost

    def step(self, rudder_rad):
        for part in range(1, 6):
            super().step(self.grip * (self.before_rad + 0.2 * part * (rudder_rad - self.before_rad)))
        self.before_rad = rudder_rad


class Sailing:
    """The tick with ship, sea, compass at 10 Hz, receiver at 1 Hz and servo; positions in metres from the start."""

    def __init__(self, scenario, seed=1, plans=None, hull=TickHull, **parameters):
        values = ParameterSet()
        for name, value in parameters.items():
            values = values.replaced(name, value)
        self.scenario = scenario
        self.hull = hull(scenario, seed)
        self.numbers = NormalNumbers(generator(seed, Stream.COMPASS))
        self.resolution_rad, self.noise_rad = RESOLUTION_RAD, NOISE_RAD
        self.rng = np.random.default_rng(seed)
        self.state = State.at_start(values, plans)
        self.index = 0
        self.rudder_rad = self.target_rad = 0.0
        self.fix_error_m = self.rng.normal(0.0, FIX_NOISE_M, 2)
        self.fix_ticks = 10  # ticks between two fixes
        self.receiver = scenario.disturbances.receiver or IDEAL_RECEIVER
        self.gaps = Gaps(self.receiver.lost, self.receiver.gap_s, generator(seed, Stream.GAPS))
        self.velocity_m_s = None
        self.delayed_fixes = [()] * round(self.receiver.latency_s / STEP_S)
        self.jump_m = (0.0, 0.0)  # north and east, added to each fix
        self.events = []
        self.inputs = []
        self.keep_inputs = False
        self.vessels_at = lambda _t_s: ()  # AIS reports of a tick
        self.snapshot = None
        self.track = []  # (t_s, north_m, east_m, heading_low_rad) each second

    @property
    def t_s(self):
        return 0.1 * self.index

    @property
    def where(self):
        """Position of the hull, north and east of the start [m]."""
        return self.hull.position_m(0.0)

    def tick(self, *intents):
        t_s = self.t_s
        heading_rad = float(self.hull.compass_heading_rad(0.0) + self.noise_rad * self.numbers.draw())
        heading_rad = round(heading_rad / self.resolution_rad) * self.resolution_rad % TWO_PI
        shaft_rad = round(self.rudder_rad / COUNT_RAD) * COUNT_RAD
        inputs = Inputs(
            Tick(self.index, t_s, 0.0001, 0, 10.0),
            (HeadingSample(t_s, heading_rad, NorthReference.TRUE),),
            self.fixes(),
            (RudderFeedback(t_s, shaft_rad),),
            (),
            tuple(Request(t_s, intent) for intent in intents),
            vessels=tuple(self.vessels_at(t_s)),
        )
        if self.keep_inputs:
            self.inputs.append(inputs)
        self.state, output = step(self.state, inputs)
        self.snapshot = output.snapshot
        self.events += [(t_s, event.text) for event in output.events]
        self.target_rad = output.command.shaft_rad
        max_step_rad = SLEW_RAD_S * STEP_S
        self.rudder_rad += min(max(self.target_rad - self.rudder_rad, -max_step_rad), max_step_rad)
        self.hull.step(self.rudder_rad)
        self.index += 1
        if self.index % 10 == 0:
            self.track.append((self.t_s, *self.where, self.hull.heading_low_rad(0.0)))
        return output

    def fixes(self):
        """Return the fix that arrives in this tick, if any; it was sampled earlier, and has the present time."""
        now_m_s = np.array(self.hull.velocity_in_waves_m_s(0.0))
        previous_m_s = now_m_s if self.velocity_m_s is None else self.velocity_m_s
        gain = -math.expm1(-STEP_S / self.receiver.filter_s) if self.receiver.filter_s > 0.0 else 1.0
        self.velocity_m_s = previous_m_s + gain * (now_m_s - previous_m_s)
        self.delayed_fixes.append((self.fix(),) if self.index % self.fix_ticks == 0 else ())
        arrived = self.delayed_fixes.pop(0)
        return tuple(replace(fix, t_s=self.t_s, utc_s=UTC_S + self.t_s) for fix in arrived if fix is not None)

    def fix(self):
        decay = math.exp(-0.1 * self.fix_ticks / FIX_MEMORY_S)
        self.fix_error_m = decay * self.fix_error_m + math.sqrt(1.0 - decay**2) * self.rng.normal(0.0, FIX_NOISE_M, 2)
        north_m, east_m = self.hull.position_in_waves_m(0.0)
        v_north, v_east = map(float, self.velocity_m_s + self.rng.normal(0.0, self.receiver.noise_m_s, 2))
        if self.gaps.is_gap(self.t_s):
            return None
        error_north_m, error_east_m = map(float, np.add(self.fix_error_m, self.jump_m))
        place = placed(float(north_m) + error_north_m, float(east_m) + error_east_m)
        return PositionSample(
            self.t_s, FixType.FIX_3D, *place, 2.0, math.hypot(v_north, v_east),
            math.atan2(v_east, v_north) % TWO_PI, 11, 0.9, UTC_S + self.t_s,
        )  # fmt: skip

    def run(self, seconds, until=lambda _boat: False):
        for _ in range(round(seconds * 10)):
            self.tick()
            if until(self):
                break
        return self

    def get_under_way(self, mode, *intents):
        """Wait for heading and position, then arm and enter a mode."""
        self.run(1.5)
        self.tick(Arm(armed=True), SetMode(mode), *intents)
        assert (self.state.modes.mode, self.state.modes.armed) == (mode, True), self.events
        return self

    def times_of(self, text):
        return [t_s for t_s, event in self.events if text in event]


@functools.cache
def on_a_mission():
    """Return a boat on the second leg of a mission; it is shared and must not be changed."""
    legs = mission(
        item(Command.WAYPOINT, 10.0, 0.0, 0, 5),
        item(Command.WAYPOINT, 300.0, 0.0, 0, 5),
        item(Command.WAYPOINT, 300.0, 300.0, 0, 5),
    )
    boat = Sailing(sea(), plans=legs).get_under_way(Mode.AUTO)
    return boat.run(120.0, until=lambda boat: boat.state.guidance.mission.index == 1).run(10.0)


def sea(name="calm", **changes):
    """Return a scenario of the table with changes."""
    return dataclasses.replace(find_scenario(name), **changes)


def scenario(speed_m_s, current_m_s=0.0, toward_deg=90.0, wave_s=6.0, wave_deg=4.0, bias_deg=5.0, **more):
    """Return a scenario that is not in the table: current towards `toward_deg`, waves of period and yaw amplitude."""
    return Scenario("made", "", speed_m_s, wave_s, wave_deg, bias_deg, 2.0, current_m_s, toward_deg, **more)
