"""What was recorded of a boat under way, in the records that a tick of the autopilot takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from firmware_py.common.records import HeadingSample, PositionSample, RudderFeedback
from hil.lab.identify.recording import Floats


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
