"""What stands in a tick: one row a fault, from the state; the monitor judges it over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from firmware_py.common.records import DeviceState, Mode
from firmware_py.core.state import Settings, State, fence_enabled, fresh
from firmware_py.estimate.sources import CompassState
from firmware_py.faults.page import TABLE, Fault
from firmware_py.guidance import guidance
from firmware_py.safety import supervisor

LATE_MEMORY_S: Final = 2.0
RESTART_MEMORY_S: Final = 5.0
COOLER_C: Final = 5.0
FULLER: Final = 1.03  # of BAT_LOW_VOLT


@dataclass(frozen=True, slots=True)
class FaultInput:
    """What a condition looks at."""

    settings: Settings
    state: State
    now_s: float

    def lost(self, t_s: float | None, timeout_s: float) -> bool:
        """Whether something is too old; what has never come counts from the start."""
        if t_s is None:
            t_s = self.state.started_s
        return t_s is not None and self.now_s - t_s > timeout_s

    def is_set(self, fault: Fault) -> bool:
        """Whether a fault was set in the last tick."""
        return self.state.monitor.is_set(fault)

    def compasses(self) -> tuple[CompassState, CompassState]:
        """What the estimate knows of the compasses."""
        return self.state.lookout.sources.compasses


def _compass_silent(sight: FaultInput) -> bool:
    timeout_s = sight.settings.observer.timeout_s
    return any(t_s is not None and sight.now_s - t_s > timeout_s for t_s in sight.state.watch.heard_s)


def _compass_frozen(sight: FaultInput) -> bool:
    return any(compass.frozen(sight.now_s, sight.settings.lookout.sources) for compass in sight.compasses())


def _compass_jumping(sight: FaultInput) -> bool:
    return any(
        compass.jumping() and fresh(compass.t_s, sight.now_s, sight.settings.observer.timeout_s)
        for compass in sight.compasses()
    )


def _position_lost(sight: FaultInput) -> bool:
    fix = sight.state.position
    return fix is not None and sight.lost(fix.t_s, sight.settings.position_timeout_s)


def _position_jumping(sight: FaultInput) -> bool:
    place = sight.state.place
    return place.suspect is not None and place.fix is not None and place.suspect.t_s > place.fix.t_s


def _rudder_silent(sight: FaultInput) -> bool:
    servo = sight.state.servo
    return sight.lost(servo.t_s if servo else None, sight.settings.rudder_timeout_s)


def _rudder_error(sight: FaultInput) -> bool:
    servo = sight.state.servo
    return servo is not None and servo.hardware_error != 0


def _rudder_hot(sight: FaultInput) -> bool:
    servo = sight.state.servo
    if servo is None or servo.temperature_c is None:
        return False
    margin_c = COOLER_C if sight.is_set(Fault.RUDDER_HOT) else 0.0
    return servo.temperature_c > sight.settings.watch.hot_c - margin_c


def _supply_low(sight: FaultInput) -> bool:
    servo = sight.state.servo
    if servo is None or servo.voltage_v is None:
        return False
    return servo.voltage_v < sight.settings.watch.low_v * (FULLER if sight.is_set(Fault.SUPPLY_LOW) else 1.0)


def _fence_breached(sight: FaultInput) -> bool:
    state = sight.state
    enabled = fence_enabled(sight.settings, state)
    margin_m = guidance.fence_margin_m(state.nav, state.plans, enabled=enabled)
    return margin_m is not None and margin_m < 0.0


def _mission_unusable(sight: FaultInput) -> bool:
    state = sight.state
    return state.modes.armed and state.modes.mode is Mode.AUTO and state.nav.mission.unusable


def _station_silent(sight: FaultInput) -> bool:
    link = sight.state.watch.link
    return (
        link is not None and link.state is DeviceState.SILENT and sight.lost(link.t_s, sight.settings.watch.station_s)
    )


def _storage(state: DeviceState) -> Callable[[FaultInput], bool]:
    return lambda sight: sight.state.storage is not None and sight.state.storage.state is state


# Whoever has a new flag plugs it in here.
PROVIDERS: Final[Mapping[Fault, Callable[[FaultInput], bool]]] = {
    Fault.COMPASS_LOST: lambda sight: sight.lost(sight.state.heading.sample_t_s, sight.settings.observer.timeout_s),
    Fault.POSITION_LOST: _position_lost,
    Fault.RUDDER_SILENT: _rudder_silent,
    Fault.RUDDER_ERROR: _rudder_error,
    Fault.LOOP_LATE: lambda sight: fresh(sight.state.skipped_t_s, sight.now_s, LATE_MEMORY_S),
    Fault.STORAGE_FAILING: _storage(DeviceState.FAULTY),
    Fault.CURRENT_STRONG: lambda sight: sight.state.current.too_strong,
    Fault.MISSION_UNUSABLE: _mission_unusable,
    Fault.FENCE_BREACHED: _fence_breached,
    Fault.COMPASS_SILENT: _compass_silent,
    Fault.COMPASS_FROZEN: _compass_frozen,
    Fault.COMPASS_JUMPING: _compass_jumping,
    Fault.COMPASS_DISAGREES: lambda sight: sight.state.lookout.sources.disagree(),
    Fault.POSITION_JUMPING: _position_jumping,
    Fault.RUDDER_ASTRAY: lambda sight: sight.state.watch.rudder.astray,
    Fault.RUDDER_JAMMED: lambda sight: sight.state.watch.rudder.jammed,
    Fault.RUDDER_HOT: _rudder_hot,
    Fault.RUDDER_OVERLOADED: lambda sight: sight.state.watch.rudder.overloaded,
    Fault.RUDDER_REPOWERED: lambda sight: fresh(sight.state.watch.restarted_s, sight.now_s, RESTART_MEMORY_S),
    Fault.SUPPLY_LOW: _supply_low,
    Fault.STORAGE_FULL: _storage(DeviceState.FULL),
    Fault.CLOCK_STEPPED: lambda sight: (
        sight.state.watch.clock is not None and sight.state.watch.clock.state is DeviceState.FAULTY
    ),
    Fault.STATION_SILENT: _station_silent,
    Fault.STEERING_LOST: lambda sight: supervisor.steering_lost(sight.state.watch),
}
_IN_ORDER: Final = tuple(PROVIDERS[row.fault] for row in TABLE)


def standing(settings: Settings, state: State, now_s: float) -> tuple[bool, ...]:
    """Whether the condition of each fault stands, in the order of faults.TABLE."""
    sight = FaultInput(settings, state, now_s)
    return tuple(stands(sight) for stands in _IN_ORDER)
