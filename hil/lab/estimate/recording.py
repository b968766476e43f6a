"""A recording as input records of the autopilot's tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from firmware_py.common.records import HeadingSample, PositionSample, RudderFeedback
from hil.errors import UsageError
from hil.lab.identify.recording import Floats

MAX_INTERVAL_S: Final = 5.0  # of headings: the largest compass timeout of the autopilot


@dataclass(frozen=True, slots=True)
class Recording:
    """The samples of a file, each type in order of time; times of samples are relative to `begin_s`.

    time_s: times of the headings of compass `source` in the file; the rows of the estimate.
    rudder: rudder angles, or shaft angles if `is_shaft`; empty if not recorded.
    goal_s, goal_rad: times (relative to begin_s) and values of the recorded goal; NaN: no goal.
    water_m_s, ground_m_s: mean speed through the water and over ground, None if not recorded.
    parameters: parameters in the file.
    """

    name: str
    begin_s: float
    time_s: Floats
    headings: tuple[HeadingSample, ...]
    positions: tuple[PositionSample, ...]
    rudder: tuple[RudderFeedback, ...]
    goal_s: Floats
    goal_rad: Floats
    source: int = 0
    is_shaft: bool = False
    water_m_s: float | None = None
    ground_m_s: float | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def check_interval(recording: Recording) -> None:
    """Raise UsageError if the interval of the headings is too large."""
    interval_s = float(np.median(np.diff(recording.time_s)))
    if not interval_s <= MAX_INTERVAL_S:
        raise UsageError(
            f"{recording.name}: the headings are {interval_s:g} s apart; give at most {MAX_INTERVAL_S:g} s, better "
            "0.05 to 1 s (are the times milliseconds? name the column time_ms)"
        )
