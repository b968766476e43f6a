"""What was recorded of a boat under way, in the records that a tick of the autopilot takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from firmware_py.common.records import HeadingSample, PositionSample, RudderFeedback
from hil.errors import UsageError
from hil.lab.identify.recording import Floats

LONGEST_INTERVAL_S: Final = 5.0  # between headings: the autopilot's longest timeout of a compass


@dataclass(frozen=True, slots=True)
class Recording:
    """The samples of one file, each kind in order of time; times of samples count from `begin_s` of the file's own.

    time_s: of the headings of compass `source`, which the estimate is given at, as the file has them.
    rudder: in the frame of the rudder unless `shaft`, empty where it was not recorded.
    goal_s, goal_rad: the recorded goal, from each of these times (from begin_s) on; NaN: none.
    water_m_s, ground_m_s: mean speed through the water and over ground, None where not recorded.
    parameters: those that the file holds.
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
    shaft: bool = False
    water_m_s: float | None = None
    ground_m_s: float | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def check_interval(recording: Recording) -> None:
    """Refuse headings that come too seldom; UsageError names the remedy."""
    usual_s = float(np.median(np.diff(recording.time_s)))
    if not usual_s <= LONGEST_INTERVAL_S:
        raise UsageError(
            f"{recording.name}: the headings are {usual_s:g} s apart; give at most {LONGEST_INTERVAL_S:g} s, better "
            "0.05 to 1 s (are the times milliseconds? name the column time_ms)"
        )
