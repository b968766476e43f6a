"""What every heading controller is given, and what any of them remembers."""

from __future__ import annotations

from collections.abc import Callable

from firmware_py.common.record_class import dataclass
from firmware_py.common.reports import HeadingEstimate
from firmware_py.control.reference_model import Reference


@dataclass(frozen=True, slots=True)
class HeadingControllerInput:
    """What a controller steers by in a tick.

    `error_rad` is the goal less the heading, positive to starboard; on a turn the long way it stays at
    half a turn. `estimate` is None while the plain observer knows heading and yaw rate alone.
    `command_rad` is the rudder command of the tick before. `softness`: by what factor the helm's crossover is to
    be bounded lower than as delivered, 1 or more.
    """

    error_rad: float
    yaw_rate_rad_s: float
    estimate: HeadingEstimate | None
    command_rad: float
    step_s: float
    softness: float = 1.0


@dataclass(frozen=True, slots=True)
class HeadingControllerState:
    """What a controller remembers from tick to tick; each keeps its own field and leaves the others at their default.

    `reference` is how a turn under way should go, `bias_rad` the rudder bias as a softened helm lets it follow.
    """

    reference: Reference | None = None
    bias_rad: float | None = None


Controller = Callable[[HeadingControllerState, HeadingControllerInput], tuple[HeadingControllerState, float | None]]
"""A controller with its settings: returns its state and the rudder angle asked for, None when it cannot steer so."""
