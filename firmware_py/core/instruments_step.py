"""Wind and depth in a tick: motion of the boat for the wind, and silent sensors."""

from __future__ import annotations

from msgspec.structs import replace

from firmware_py.common.records import Event, Inputs
from firmware_py.core import instruments
from firmware_py.core.freshness import Age, Freshness
from firmware_py.core.state import Settings, State
from firmware_py.estimate import heading_estimator


def watch_instruments(
    settings: Settings, state: State, inputs: Inputs, freshness: Freshness
) -> tuple[State, tuple[Event, ...]]:
    """Return the state updated with wind and depth, and the events; unchanged without input of these sensors."""
    if not (inputs.wind or inputs.depth or inputs.devices or instruments.is_expected(state.instruments)):
        return state, ()
    current, events = instruments.report_silence(state.instruments, inputs.devices, inputs.tick.t_s)
    if inputs.wind or inputs.depth:
        estimator, fix = state.heading_estimator, state.position.fix
        by_model = estimator.declination.declination_rad if settings.heading_estimator.declination_by_model else None
        motion = instruments.boat_motion(
            estimator.heading.heading_rad if freshness.heading is Age.FRESH else None,
            fix if freshness.position is Age.FRESH else None,
            heading_estimator.water_report(estimator),
            settings.heading_estimator.observer.declination_rad if by_model is None else by_model,
        )
        current = instruments.update(current, inputs, motion)
    return (state if current is state.instruments else replace(state, instruments=current)), events
