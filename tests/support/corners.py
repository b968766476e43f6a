"""A boat in a closed loop with the step function, with any parameters and any kind of compass.

The simulated boat always turns well, independent of its parameters. Each command is checked.
"""

import math
import random

from firmware_py.common.angles import wrap_two_pi
from firmware_py.common.intents import Arm, Request, SetMode, SetParameter, SteerHeading
from firmware_py.common.parameter_row import Kind
from firmware_py.common.parameter_table import TABLE
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
from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from fuzz.target import check_finite, check_line

# Resolution [deg], interval [s], noise [deg].
COMPASSES = {
    "fine": (0.0, 0.1, 0.3),
    "whole degrees": (1.0, 1.0, 0.0),
    "coarse": (5.0, 0.1, 0.0),
    "noisy": (0.1, 0.05, 8.0),
    "slow": (0.1, 5.0, 0.2),
    "frozen": (360.0, 0.1, 0.0),
    "spinning": (0.0, 0.1, 180.0),
    "gaps": (0.1, 0.7, 0.1),
    "absent": (0.0, math.inf, 0.0),
}
FREE = tuple(row for row in TABLE if not row.read_only)
GUIDED = 15
PLACE = (0.6283, 2.1118)
EARTH_RADIUS_M = 6.371e6
GOAL_INTERVAL_S = 4.0
MAX_TURN_RAD = 2.5
ARM_S = 2.0


def value_at_share(row, share):
    """Return the valid value of a parameter at a share of its range, from 0 to 1."""
    if row.choices is not None:
        return sorted(row.choices)[min(int(share * len(row.choices)), len(row.choices) - 1)]
    value = row.minimum + share * (row.maximum - row.minimum)
    return math.floor(value) if row.kind is Kind.INTEGER else value


def parameters_with(values):
    parameters = ParameterSet()
    for name, value in values.items():
        parameters = parameters.replaced(name, value)
    return parameters


class CheckedBoat:
    """An armed boat; the parameters of `later` are set GOAL_INTERVAL_S after arming."""

    def __init__(self, values, compass, later=(), mode=GUIDED, seed=1):
        self.state, self.draw = State.at_start(parameters_with(values)), random.Random(seed)
        self.step_deg, self.interval_s, self.noise_deg = COMPASSES[compass]
        self.orders = [Request(ARM_S, Arm(armed=True, force=True)), Request(ARM_S, SetMode(mode))]
        self.orders += [Request(ARM_S + GOAL_INTERVAL_S, SetParameter(*item)) for item in dict(later).items()]
        self.index, self.now_s, self.heading_due_s, self.goal_due_s = 0, 0.0, 0.0, ARM_S
        self.heading_rad, self.rate_rad_s, self.shaft_rad = 1.0, 0.0, 0.0
        self.north_m = self.east_m = 0.0

    def run(self, seconds):
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.tick()
        text = state_to_text(self.state)
        restored, notes = state_from_text(text)
        assert notes == ()
        assert state_to_text(restored) == text

    def headings(self):
        if self.now_s < self.heading_due_s:
            return ()
        self.heading_due_s = self.now_s + self.interval_s
        reading_deg = math.degrees(self.heading_rad) + self.draw.gauss(0.0, 1.0) * self.noise_deg
        if self.step_deg:
            reading_deg = self.step_deg * round(reading_deg / self.step_deg)
        reading_rad = wrap_two_pi(math.radians(reading_deg))
        return tuple(
            HeadingSample(self.now_s, reading_rad, NorthReference.MAGNETIC, source=source) for source in (0, 1)
        )

    def positions(self):
        if self.index % 10:
            return ()
        latitude_rad = PLACE[0] + self.north_m / EARTH_RADIUS_M
        longitude_rad = PLACE[1] + self.east_m / EARTH_RADIUS_M / math.cos(PLACE[0])
        place = (latitude_rad, longitude_rad, 2.0, 0.5, wrap_two_pi(self.heading_rad), 11, 0.9, 1.7e9 + self.now_s)
        return (PositionSample(self.now_s, FixType.FIX_3D, *place),)

    def requests(self):
        due = tuple(order for order in self.orders if order.t_s <= self.now_s)
        self.orders = [order for order in self.orders if order not in due]
        if self.now_s >= self.goal_due_s:
            self.goal_due_s += GOAL_INTERVAL_S
            goal_rad = self.heading_rad + self.draw.uniform(-MAX_TURN_RAD, MAX_TURN_RAD)
            due += (Request(self.now_s, SteerHeading(wrap_two_pi(goal_rad))),)
        return due

    def tick(self):
        rudder = (RudderFeedback(self.now_s, self.shaft_rad, 30.0, 12.0, 0.1, 0, torque_on=True),)
        tick = Tick(self.index, self.now_s, 0.0, 0, 10.0)
        inputs = Inputs(tick, self.headings(), self.positions(), rudder, (), self.requests())
        command_rad = self.state.rudder.command_rad
        self.state, output = step(self.state, inputs)
        check_finite(output.command)
        check_finite(output.snapshot)
        reference = self.state.controller.reference
        assert math.isnan(reference.heading_rad) or all(map(math.isfinite, reference)), reference
        for event in output.events:
            check_line(event.text)
        parameters = self.state.parameters
        max_rad = max(math.radians(parameters["RUD_LIMIT_DEG"]), abs(command_rad))  # the limit may have become smaller
        assert abs(self.state.rudder.command_rad) <= max_rad + 1e-9
        if output.command.torque_on:
            self.shaft_rad = output.command.shaft_rad
        step_s = 1.0 / parameters["LOOP_RATE_HZ"]
        shaft_angle_rad = self.shaft_rad - math.radians(parameters["RUD_CENTRE_DEG"])
        angle_rad = -shaft_angle_rad if parameters["RUD_REVERSE"] else shaft_angle_rad
        self.rate_rad_s += (0.1 * angle_rad - self.rate_rad_s) * -math.expm1(-step_s / 2.0)
        self.heading_rad += step_s * self.rate_rad_s
        self.north_m += step_s * 0.5 * math.cos(self.heading_rad)
        self.east_m += step_s * 0.5 * math.sin(self.heading_rad)
        self.index += 1
        self.now_s += step_s
