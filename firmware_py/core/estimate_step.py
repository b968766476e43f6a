"""The estimates of a tick, in their order: rudder, heading, position, water, home."""

from __future__ import annotations

import math
from dataclasses import replace

from firmware_py.common.records import Event, Inputs, PositionSample, RudderStatus
from firmware_py.common.reports import Home
from firmware_py.core import device_reports, rudder, tick_timing
from firmware_py.core.state import Settings, State, heading_timeouts_of
from firmware_py.estimate import heading_estimator, position, water
from firmware_py.estimate.water import WaterState


def estimate(settings: Settings, state: State, inputs: Inputs) -> tuple[State, RudderStatus, tuple[Event, ...]]:
    """Take samples, feedback, device reports and the tick itself in; return what is known of the rudder, too."""
    now_s = inputs.tick.t_s
    rudder_state, rudder_status = rudder.update(settings.rudder, state.rudder, inputs)
    # As known before this tick: a gap must not excuse itself.
    timeouts = heading_timeouts_of(settings, state.devices)
    heading_state, events = heading_estimator.update(
        settings.heading_estimator,
        state.heading_estimator,
        inputs.headings,
        inputs.positions,
        rudder_status.angle_rad,
        timeouts,
        now_s,
    )
    heading = heading_state.heading
    heading_rad = heading.heading_rad if heading.fresh(now_s, timeouts.of(heading_state.sources.in_use)) else None
    place = position.predict(state.position, now_s, _over_ground_m_s(state.water, heading_rad))
    home = state.home
    credible = []
    for sample in inputs.positions:
        place, good = position.update(place, sample, settings.position.jump_s)
        if good:
            credible.append(sample)
            home = home or _first_home(sample)
    state = replace(
        state,
        timing=tick_timing.update(state.timing, inputs.tick),
        devices=device_reports.update(settings.freshness, state.devices, inputs),
        rudder=rudder_state,
        heading_estimator=heading_state,
        position=place,
        water=water.update(state.water, heading_rad, credible, now_s),
        home=home,
    )
    return state, rudder_status, events


def _over_ground_m_s(state: WaterState, heading_rad: float | None) -> tuple[float, float]:
    """Return the boat's velocity over ground as estimated, north and east."""
    north_m_s, east_m_s, speed_m_s = state.mean
    if heading_rad is None:
        return north_m_s, east_m_s
    return north_m_s + speed_m_s * math.cos(heading_rad), east_m_s + speed_m_s * math.sin(heading_rad)


def _first_home(sample: PositionSample) -> Home | None:
    """Return the first fix since start: it is home until one is set."""
    if sample.latitude_rad is None or sample.longitude_rad is None:
        return None
    return Home(sample.latitude_rad, sample.longitude_rad, sample.altitude_m or 0.0)
