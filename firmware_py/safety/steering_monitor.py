"""Steering authority: whether the boat turns when the rudder moves, and the way it is to turn her.

Headings and rudder are taken together by blocks, for both judges: whether she answers at all (rudder_answer.py), and
whether she turns the other way, again and again, as one does whose servo is set up the wrong way round (wrong_way.py).
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import clamp, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import KtModel
from firmware_py.safety import rudder_answer, wrong_way
from firmware_py.safety.rudder_answer import RudderAnswerState
from firmware_py.safety.turn_order import ordered_s
from firmware_py.safety.wrong_way import Turn, WrongWay

SLOW_S: Final = 60.0  # what changes slower than this is trim
BLOCK_S: Final = 2.0


class SteeringMonitorSettings(msgspec.Struct, frozen=True):
    """The boat's model, and which way round the servo is set up."""

    model: KtModel
    servo_reversed: bool = False

    @classmethod
    def of(cls, parameters: ParameterSet) -> SteeringMonitorSettings:
        """Read the settings from the parameters."""
        return cls(model=KtModel.of(parameters), servo_reversed=bool(parameters["RUD_REVERSE"]))


class SteeringInput(msgspec.Struct, frozen=True):
    """What a tick shows: the measured rudder, the estimated heading and its standard deviation, the speed, the error.

    `heading_rad` is None while nothing is to be learned. `shown_rad` is what the compass shows, None without one.
    `error_rad` is how far the boat is off the heading to steer, None while nobody steers for one.
    """

    rudder_rad: float
    heading_rad: float | None
    heading_sd_rad: float
    speed_m_s: float
    error_rad: float | None
    shown_rad: float | None = None


class Block(msgspec.Struct, frozen=True):
    """A stretch of time: when and with what headings it began, and the integral of the rudder [rad s] up to `t_s`."""

    begun_s: float
    heading_rad: float
    t_s: float
    rudder_rad_s: float = 0.0
    shown_rad: float | None = None


class SteeringMonitorState(msgspec.Struct, frozen=True):
    """The block under way, the slow parts of rudder and speed, and the judges.

    The slow parts begin amidships: at the start the boat may be in the middle of a turn. They wait while the rudder
    orders one, or a long turn would become the trim, and a turn that does not come a loss of way. `order_s`: for how
    long it has, to starboard, negative to port.
    """

    order_s: float = 0.0
    slow_rudder_rad: float = 0.0
    slow_speed_m_s: float | None = None
    block: Block | None = None
    wrong_way: WrongWay = WrongWay()
    answer: RudderAnswerState = RudderAnswerState()


def update(
    settings: SteeringMonitorSettings, state: SteeringMonitorState, given: SteeringInput, now_s: float
) -> SteeringMonitorState:
    """Take a tick in. The turn is that of the heading over a block, and the rudder its mean.

    The estimated yaw rate would not do: it expects a turn of the rudder, and the heading is drawn back to what the
    compass says.
    """
    if settings.servo_reversed is not state.wrong_way.servo_reversed:
        state = replace(state, wrong_way=WrongWay(servo_reversed=settings.servo_reversed))
    if given.heading_rad is None or not math.isfinite(given.rudder_rad):
        if state.block is None:
            return state
        return replace(state, block=None, answer=rudder_answer.interrupted(state.answer))
    block = state.block
    if block is None or now_s < block.t_s:
        return replace(state, block=Block(now_s, given.heading_rad, now_s, shown_rad=given.shown_rad))
    rudder_rad_s = block.rudder_rad_s + given.rudder_rad * (now_s - block.t_s)
    step_s = now_s - block.begun_s
    if step_s < BLOCK_S:
        return replace(state, block=Block(block.begun_s, block.heading_rad, now_s, rudder_rad_s, block.shown_rad))
    turned_rad = wrap_pi(given.heading_rad - block.heading_rad)
    begun_rad = block.shown_rad
    shown_rad = 0.0 if begun_rad is None or given.shown_rad is None else wrap_pi(given.shown_rad - begun_rad)
    state = compare(settings.model, state, given, Turn(rudder_rad_s / step_s, turned_rad, shown_rad, step_s))
    return replace(state, block=Block(now_s, given.heading_rad, now_s, shown_rad=given.shown_rad))


def compare(model: KtModel, state: SteeringMonitorState, given: SteeringInput, turn: Turn) -> SteeringMonitorState:
    """Let the judges see what the boat turned in a block."""
    block, step_s, error_rad = (turn.rudder_rad, turn.turned_rad, turn.step_s), turn.step_s, given.error_rad
    sd_rad, speed_m_s = given.heading_sd_rad, given.speed_m_s
    answer = rudder_answer.update(model, state.answer, block, sd_rad, speed_m_s, error_rad)
    slow_speed_m_s = speed_m_s if state.slow_speed_m_s is None else state.slow_speed_m_s
    model = model.at_speed(clamp(slow_speed_m_s, 0.1 * model.speed_m_s, 10.0 * model.speed_m_s))
    way = wrong_way.update(model, state.wrong_way, turn, state.slow_rudder_rad, error_rad, sd_rad)
    over_rad = turn.rudder_rad - state.slow_rudder_rad
    order_s = ordered_s(state.order_s, over_rad, error_rad, step_s)
    state = replace(state, wrong_way=way, order_s=order_s, answer=answer)
    # By hand she may be kept straight with any trim.
    if order_s != 0.0 and error_rad is not None:
        return state
    part = 1.0 - math.exp(-step_s / SLOW_S)
    return replace(
        state,
        slow_rudder_rad=state.slow_rudder_rad + part * over_rad,
        slow_speed_m_s=slow_speed_m_s + part * (speed_m_s - slow_speed_m_s),
    )
