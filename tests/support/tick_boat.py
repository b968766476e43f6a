"""A K-T boat whose ticks are computed by core/step.py."""

import math
import random

from msgspec.structs import replace

from firmware_py.common.intents import (
    Arm,
    Request,
    SetMode,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    PowerSample,
    RudderFeedback,
    Tick,
)
from firmware_py.core.state import State
from firmware_py.core.step import step
from firmware_py.model.kt import rk4_step

FIX = PositionSample(0.0, FixType.FIX_3D, 0.5, 0.5)


class Boat:
    """A K-T boat with the tick at 10 Hz."""

    def __init__(self, parameters=None, heading_rad=0.5, noise_rad=0.0, seed=1):
        self.state = State.at_start(parameters or ParameterSet())
        self.heading_rad, self.rate_rad_s, self.shaft_rad = heading_rad, 0.0, 0.0
        self.index = 0
        self.measures, self.effect = True, 1.0  # whether the servo measures its angle; effect of the rudder
        self.compass = self.servo = True  # whether they send
        self.compass_ticks = self.position_ticks = self.servo_ticks = 1  # interval of samples
        self.position = None
        self.noise_rad, self.rng = noise_rad, random.Random(seed)
        self.hardware_error = 0
        self.charge = None  # of the battery
        self.events, self.outputs, self.inputs = [], [], []

    @property
    def t_s(self):
        return 0.1 * self.index

    def tick(self, *intents, skipped=0, devices=()):
        t_s = self.t_s
        heading = HeadingSample(
            t_s - 0.002, (self.heading_rad + self.rng.gauss(0.0, self.noise_rad)) % (2 * math.pi), NorthReference.TRUE
        )
        shaft_rad = self.shaft_rad if self.measures else None
        feedback = RudderFeedback(t_s - 0.05, shaft_rad, hardware_error=self.hardware_error)
        inputs = Inputs(
            Tick(self.index, t_s, 0.0001, skipped, 10.0),
            (heading,) if self.compass and self.index % self.compass_ticks == 0 else (),
            (replace(self.position, t_s=t_s),) if self.position and self.index % self.position_ticks == 0 else (),
            (feedback,) if self.servo and self.index % self.servo_ticks == 0 else (),
            devices,
            tuple(Request(t_s - 0.01, intent) for intent in intents),
            () if self.charge is None else (PowerSample(t_s, 0, 12.8, -0.3, self.charge),),
        )
        self.state, output = step(self.state, inputs)
        self.inputs.append(inputs)
        self.outputs.append(output)
        self.events += [event.text for event in output.events]
        if self.servo:
            self.shaft_rad = output.command.shaft_rad
        self.heading_rad, self.rate_rad_s = rk4_step(
            self.heading_rad, self.rate_rad_s, self.effect * self.shaft_rad, 0.1, 0.049, 4.0, 17.0, 0.0
        )
        if self.position:
            self.sail(0.1)
        self.index += 1
        return output

    def sail(self, step_s, speed_m_s=0.4):
        north_rad = step_s * speed_m_s * math.cos(self.heading_rad) / 6371008.8
        east_rad = step_s * speed_m_s * math.sin(self.heading_rad) / 6371008.8
        self.position = replace(
            self.position,
            latitude_rad=self.position.latitude_rad + north_rad,
            longitude_rad=self.position.longitude_rad + east_rad / math.cos(self.position.latitude_rad),
            speed_over_ground_m_s=speed_m_s,
            course_over_ground_rad=self.heading_rad % (2 * math.pi),
        )

    def run(self, seconds, **options):
        for _ in range(round(seconds * 10)):
            output = self.tick(**options)
        return output

    def pass_time(self, seconds):
        """Tick once a second, for conditions that last minutes; the boat hardly moves."""
        for _ in range(round(seconds)):
            self.index += 9
            output = self.tick()
        return output

    def get_under_way(self, mode=Mode.GUIDED):
        self.run(0.3)
        self.tick(Arm(armed=True), SetMode(mode))
        assert (self.state.modes.mode, self.state.modes.armed) == (mode, True)
        return self


def error_deg(boat, goal_rad):
    return abs(math.degrees(math.remainder(boat.heading_rad - goal_rad, 2 * math.pi)))
