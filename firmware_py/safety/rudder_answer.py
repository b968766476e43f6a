"""Whether she answers the rudder's changes, which no trim and no wind imitates.

What turns her besides the rudder changes slowly. So the rudder and her turning are compared without their slow parts,
in a sequential test (Page's, 1954): she answers by at least a half of what her model says, or not at all, block by
block, each weighed by what waves, gusts and the uncertainty of the heading make of it. A boat that answers late, or
sluggishly, or the other way than she is to, answers: every such boat has a sum of its own, and only when she is none
of them all does she not answer.

A helm that holds her against gusts moves the rudder as much, and she does not turn: so what speaks against her counts
only while she is far off and the change of the rudder is to bring her there.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_py.common.angles import clamp, radians
from firmware_py.common.record_class import dataclass
from firmware_py.model.kt import KtModel, decay_over

# The boats that answer: after so many blocks, by how many times the turning lag, and to which side.
BOATS: Final = (
    *((blocks, lags, 1.0) for lags in (1.0, 3.0) for blocks in (0, 2, 4, 6)),
    *((blocks, lags, -1.0) for lags in (1.0, 3.0) for blocks in (0, 4)),
)
SHARE: Final = 0.5  # of the turn that the model expects, at least
SLOW_S: Final = 30.0
SPEED_S: Final = 600.0
FAR_OFF_RAD: Final = radians(10.0)
OTHERS_RAD: Final = radians(6.0)  # of rudder, that waves and gusts turn her as much as
SPREADS: Final = 0.5  # of the heading's standard deviation, that it errs by from block to block
ENOUGH: Final = 7.0  # 4.3 were reached, in gusts, in 24 h of turns in each of eleven seas with nothing left out


@dataclass(frozen=True, slots=True)
class Boat:
    """The rudder as one of BOATS feels it, the slow part of that, and what speaks against her being this one."""

    felt_rad: float = 0.0
    slow_rad: float = 0.0
    against: float = 0.0


@dataclass(frozen=True, slots=True)
class RudderAnswerState:
    """The rudder of the latest blocks, newest first, and of the turning, in rudder, the slow part; the slow speed."""

    rudders_rad: tuple[float, ...] = (0.0,) * 7
    slow_rad: float = 0.0
    speed_m_s: float | None = None
    boats: tuple[Boat, ...] = (Boat(),) * len(BOATS)

    @property
    def missing(self) -> bool:
        """Whether she is none of the boats that answer."""
        return min(boat.against for boat in self.boats) > ENOUGH


def update(
    model: KtModel,
    state: RudderAnswerState,
    block: tuple[float, float, float],
    heading_sd_rad: float,
    speed_m_s: float,
    error_rad: float | None,
    *,
    told: bool = False,
) -> RudderAnswerState:
    """Take a block in: its mean rudder, what she turned in it, and how long it was; an error of None is by hand.

    Once it is told that she does not answer, no more evidence is added up: it would outweigh for hours that she does
    again.
    """
    rudder_rad, turned_rad, step_s = block
    slow_m_s = speed_m_s if state.speed_m_s is None else state.speed_m_s
    slow_m_s += (1.0 - math.exp(-step_s / SPEED_S)) * (speed_m_s - slow_m_s)
    model = model.at_speed(clamp(slow_m_s, 0.1 * model.speed_m_s, 10.0 * model.speed_m_s))
    part = 1.0 - math.exp(-step_s / SLOW_S)
    by_rudder_s = 1.0 / (model.turning_ability_1_s * step_s)
    shown_rad, unsure_rad = turned_rad * by_rudder_s, SPREADS * heading_sd_rad * by_rudder_s
    slow_rad = state.slow_rad + part * (shown_rad - state.slow_rad)
    weight = 0.5 * step_s / (2.0 * (OTHERS_RAD * OTHERS_RAD + unsure_rad * unsure_rad))
    rudders_rad = (rudder_rad, *state.rudders_rad[:-1])
    boats = []
    for (late, lags, side), boat in zip(BOATS, state.boats, strict=True):
        lag_s, over_rad = lags * model.turning_lag_s, boat.felt_rad - side * rudders_rad[late]
        gone = 1.0 - decay_over(step_s, lag_s)
        felt_rad = boat.felt_rad - over_rad * gone
        mean_rad = side * rudders_rad[late] + over_rad * gone * lag_s / step_s
        level_rad = boat.slow_rad + part * (mean_rad - boat.slow_rad)
        least_rad = SHARE * (mean_rad - level_rad)
        gained = weight * least_rad * (least_rad - 2.0 * (shown_rad - slow_rad))
        if error_rad is not None and (abs(error_rad) < FAR_OFF_RAD or error_rad * side * least_rad < 0.0):
            gained = min(gained, 0.0)
        boats.append(Boat(felt_rad, level_rad, 0.0 if told else max(boat.against + gained, 0.0)))
    return RudderAnswerState(rudders_rad, slow_rad, slow_m_s, tuple(boats))
