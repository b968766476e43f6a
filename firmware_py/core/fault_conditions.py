"""What stands in a tick: one row a fault, from the state; the monitor judges it over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from firmware_py.common.records import DeviceState, Mode
from firmware_py.core.freshness import Age, Freshness, is_fresh
from firmware_py.core.state import Settings, State, fence_enabled
from firmware_py.estimate.sources import CompassState
from firmware_py.faults.page import TABLE, Fault
from firmware_py.guidance import guidance

LATE_MEMORY_S: Final = 2.0
RESTART_MEMORY_S: Final = 5.0
COOLER_C: Final = 5.0
FULLER: Final = 1.03  # of BAT_LOW_VOLT


@dataclass(frozen=True, slots=True)
class FaultInput:
    """What a condition looks at."""

    settings: Settings
    state: State
    freshness: Freshness
    now_s: float

    def lost(self, t_s: float | None, timeout_s: float) -> bool:
        """Whether something is too old; what has never come counts from the start."""
        if t_s is None:
            t_s = self.state.timing.started_s
        return t_s is not None and self.now_s - t_s > timeout_s

    def is_set(self, fault: Fault) -> bool:
        """Whether a fault was set in the last tick."""
        return self.state.fault_latch.is_set(fault)

    def compasses(self) -> tuple[CompassState, CompassState]:
        """What the estimate knows of the compasses."""
        return self.state.heading_estimator.sources.compasses


def _compass_silent(sight: FaultInput) -> bool:
    timeout_s = sight.settings.freshness.heading_timeout_s
    return any(t_s is not None and sight.now_s - t_s > timeout_s for t_s in sight.state.devices.compass_s)


def _compass_frozen(sight: FaultInput) -> bool:
    return any(compass.frozen(sight.now_s, sight.settings.heading_estimator.sources) for compass in sight.compasses())


def _compass_jumping(sight: FaultInput) -> bool:
    return any(
        compass.jumping() and is_fresh(compass.t_s, sight.now_s, sight.settings.freshness.heading_timeout_s)
        for compass in sight.compasses()
    )


def _position_lost(sight: FaultInput) -> bool:
    return sight.state.position.fix is not None and sight.freshness.position is Age.OLD


def _position_jumping(sight: FaultInput) -> bool:
    place = sight.state.position
    return place.suspect is not None and place.fix is not None and place.suspect.t_s > place.fix.t_s


def _rudder_error(sight: FaultInput) -> bool:
    servo = sight.state.rudder.feedback
    return servo is not None and servo.hardware_error != 0


def _rudder_hot(sight: FaultInput) -> bool:
    servo = sight.state.rudder.feedback
    if servo is None or servo.temperature_c is None:
        return False
    margin_c = COOLER_C if sight.is_set(Fault.RUDDER_HOT) else 0.0
    return servo.temperature_c > sight.settings.supervisor.hot_c - margin_c


def _supply_low(sight: FaultInput) -> bool:
    servo = sight.state.rudder.feedback
    if servo is None or servo.voltage_v is None:
        return False
    return servo.voltage_v < sight.settings.supervisor.low_v * (FULLER if sight.is_set(Fault.SUPPLY_LOW) else 1.0)


def _fence_breached(sight: FaultInput) -> bool:
    state = sight.state
    enabled = fence_enabled(sight.settings, state)
    margin_m = guidance.fence_margin_m(state.guidance, state.plans, enabled=enabled)
    return margin_m is not None and margin_m < 0.0


def _mission_unusable(sight: FaultInput) -> bool:
    state = sight.state
    return state.modes.armed and state.modes.mode is Mode.AUTO and state.guidance.mission.unusable


def _station_silent(sight: FaultInput) -> bool:
    link = sight.state.devices.link
    return (
        link is not None
        and link.state is DeviceState.SILENT
        and sight.lost(link.t_s, sight.settings.supervisor.station_s)
    )


def _storage(state: DeviceState) -> Callable[[FaultInput], bool]:
    return lambda sight: sight.state.devices.storage is not None and sight.state.devices.storage.state is state


# Whoever has a new flag plugs it in here.
PROVIDERS: Final[Mapping[Fault, Callable[[FaultInput], bool]]] = {
    Fault.COMPASS_LOST: lambda sight: sight.freshness.heading is Age.OLD,
    Fault.POSITION_LOST: _position_lost,
    Fault.RUDDER_SILENT: lambda sight: sight.freshness.rudder is Age.OLD,
    Fault.RUDDER_ERROR: _rudder_error,
    Fault.LOOP_LATE: lambda sight: is_fresh(sight.state.timing.skipped_t_s, sight.now_s, LATE_MEMORY_S),
    Fault.STORAGE_FAILING: _storage(DeviceState.FAULTY),
    Fault.CURRENT_STRONG: lambda sight: sight.state.water.too_strong,
    Fault.MISSION_UNUSABLE: _mission_unusable,
    Fault.FENCE_BREACHED: _fence_breached,
    Fault.COMPASS_SILENT: _compass_silent,
    Fault.COMPASS_FROZEN: _compass_frozen,
    Fault.COMPASS_JUMPING: _compass_jumping,
    Fault.COMPASS_DISAGREES: lambda sight: sight.state.heading_estimator.sources.disagree(),
    Fault.POSITION_JUMPING: _position_jumping,
    Fault.RUDDER_ASTRAY: lambda sight: sight.state.supervisor.rudder_monitor.deviating,
    Fault.RUDDER_JAMMED: lambda sight: sight.state.supervisor.rudder_monitor.jammed,
    Fault.RUDDER_HOT: _rudder_hot,
    Fault.RUDDER_OVERLOADED: lambda sight: sight.state.supervisor.rudder_monitor.overloaded,
    Fault.RUDDER_REPOWERED: lambda sight: is_fresh(sight.state.rudder.restarted_s, sight.now_s, RESTART_MEMORY_S),
    Fault.SUPPLY_LOW: _supply_low,
    Fault.STORAGE_FULL: _storage(DeviceState.FULL),
    Fault.CLOCK_STEPPED: lambda sight: (
        sight.state.devices.clock is not None and sight.state.devices.clock.state is DeviceState.FAULTY
    ),
    Fault.STATION_SILENT: _station_silent,
    Fault.STEERING_LOST: lambda sight: sight.state.supervisor.steering_monitor.steering_lost,
}
_IN_ORDER: Final = tuple(PROVIDERS[row.fault] for row in TABLE)


def standing(settings: Settings, state: State, freshness: Freshness, now_s: float) -> tuple[bool, ...]:
    """Whether the condition of each fault stands, in the order of faults.TABLE."""
    sight = FaultInput(settings, state, freshness, now_s)
    return tuple(stands(sight) for stands in _IN_ORDER)
