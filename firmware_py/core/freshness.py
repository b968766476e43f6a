"""How old what is steered by is: judged once, before the fault conditions, and by nobody else."""

from __future__ import annotations

from enum import IntEnum

import msgspec

from firmware_py.common.parameters import ParameterSet


class Age(IntEnum):
    """How old the newest value of a kind is."""

    AWAITED = 0  # none has come yet, and the start is not long ago
    FRESH = 1
    OLD = 2  # the newest one, or the start while none has come, is longer ago than its timeout


class FreshnessSettings(msgspec.Struct, frozen=True):
    """How old heading, position and the servo's feedback may be where they come often enough (common/silence.py)."""

    heading_timeout_s: float
    position_timeout_s: float
    rudder_timeout_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> FreshnessSettings:
        """Read the settings from the parameters."""
        return cls(
            heading_timeout_s=parameters["CMP_TIMEOUT_S"],
            position_timeout_s=parameters["POS_TIMEOUT_S"],
            rudder_timeout_s=parameters["RUD_TIMEOUT_S"],
        )


class Freshness(msgspec.Struct, frozen=True):
    """The age of heading, position and the servo's feedback in a tick."""

    heading: Age
    position: Age
    rudder: Age


def age_of(t_s: float | None, started_s: float | None, now_s: float, timeout_s: float) -> Age:
    """Return the age of what came at t_s; what has never come counts from the start."""
    if t_s is not None:
        return Age.FRESH if now_s - t_s <= timeout_s else Age.OLD
    return Age.OLD if started_s is not None and now_s - started_s > timeout_s else Age.AWAITED
