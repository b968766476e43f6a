"""The heading controller that CTL_MODE chooses: from a heading error to a rudder demand.

A new controller is a module beside `s_surface` and `scheduled`, one row of TABLE, and one value of
the parameter CTL_MODE; what it remembers is a field of `HeadingControllerState`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.record_class import dataclass
from firmware_py.control import s_surface, scheduled
from firmware_py.control.controller import Controller, HeadingControllerInput, HeadingControllerState
from firmware_py.control.s_surface import Gains
from firmware_py.control.scheduled import ScheduledSettings

__all__ = ["TABLE", "HeadingControllerInput", "HeadingControllerSettings", "HeadingControllerState", "update"]

# By the value of CTL_MODE.
TABLE: Final[Mapping[int, Callable[[ParameterSet], Controller]]] = {
    0: lambda parameters: partial(s_surface.update, Gains.of(parameters)),
    1: lambda parameters: partial(scheduled.update, ScheduledSettings.of(parameters)),
}


@dataclass(frozen=True, slots=True)
class HeadingControllerSettings:
    """The controller that steers, and the gains of the S-surface that stands in for it."""

    controller: Controller
    stand_in: Gains

    @classmethod
    def of(cls, parameters: ParameterSet) -> HeadingControllerSettings:
        """Read the settings from the parameters."""
        return cls(controller=TABLE[int(parameters["CTL_MODE"])](parameters), stand_in=Gains.of(parameters))


def update(
    settings: HeadingControllerSettings, state: HeadingControllerState, given: HeadingControllerInput
) -> tuple[HeadingControllerState, float]:
    """Return the state and the rudder demand [rad]; the S-surface stands in for a controller that cannot steer."""
    state, demand_rad = settings.controller(state, given)
    return s_surface.update(settings.stand_in, state, given) if demand_rad is None else (state, demand_rad)
