"""Age of heading, position and servo feedback; evaluated once a tick, before the fault conditions."""

from __future__ import annotations

from enum import Enum, auto

import msgspec

from firmware_py.common.parameters import ParameterSet


class Age(Enum):
    """Age of the last value of a kind."""

    AWAITED = auto()  # no value yet, and the time-out since the start has not passed
    FRESH = auto()
    OLD = auto()  # the time-out since the last value, or since the start, has passed


class FreshnessSettings(msgspec.Struct, frozen=True):
    """Minimum time-outs of heading, position and servo feedback (common/sample_timeout.py)."""

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
    """Ages of heading, position and servo feedback in a tick."""

    heading: Age
    position: Age
    rudder: Age


def age_of(t_s: float | None, started_s: float | None, now_s: float, timeout_s: float) -> Age:
    """Return the age of a value received at t_s; without a value (None) it is measured from the start."""
    if t_s is not None:
        return Age.FRESH if now_s - t_s <= timeout_s else Age.OLD
    return Age.OLD if started_s is not None and now_s - started_s > timeout_s else Age.AWAITED
