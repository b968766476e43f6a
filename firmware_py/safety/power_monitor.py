"""What battery and panels do, put together from all who measure, and the energy that has flowed.

A monitor sees all of the battery's current, a charger only what goes through it. So the battery is as the first monitor
says, the boat's own before another component's; without one it is as a charger says that has the loads on its load
output. What panels give is what chargers put out. What the loads take is that less what goes into the battery.

Energy is power times the time since the word before, and the time for which that is known is counted beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.records import PowerSample
from firmware_py.common.reports import Flow, Power

FRESH_S: Final = 15.0  # another component may speak once in five seconds
COMPANION: Final = 2  # PowerSample.source of another MAVLink component
Samples = tuple[PowerSample | None, PowerSample | None, PowerSample | None]


class PowerMonitorState(msgspec.Struct, frozen=True):
    """The newest sample by its source, the time of the newest, and what has flowed since start."""

    samples: Samples = (None, None, None)
    updated_s: float | None = None
    solar: Flow = Flow()
    load: Flow = Flow()
    charged: Flow = Flow()
    discharged: Flow = Flow()


class Supply(msgspec.Struct, frozen=True):
    """Battery, panels and loads at a moment, None for what nobody measures; a current into the battery is positive."""

    voltage_v: float | None = None
    current_a: float | None = None
    charge: float | None = None
    temperature_c: float | None = None
    solar_w: float | None = None
    load_w: float | None = None

    @property
    def battery_w(self) -> float | None:
        """What goes into the battery."""
        if self.voltage_v is None or self.current_a is None:
            return None
        return self.voltage_v * self.current_a


UNKNOWN: Final = Supply()


def supply(state: PowerMonitorState, now_s: float) -> Supply:
    """Return what is known of the supply at now_s."""
    if state.updated_s is None:
        return UNKNOWN
    fresh = [one for one in state.samples if one is not None and now_s - one.t_s <= FRESH_S]
    chargers = [one for one in fresh if one.solar_w is not None]
    monitors = [one for one in fresh if one.solar_w is None]
    voltage_v = _first(monitors, lambda one: one.voltage_v)
    if voltage_v is None:
        voltage_v = _first(chargers, lambda one: one.voltage_v)
    solar_w = _sum([_given_w(one) for one in chargers])
    output_w = _sum([_output_w(one) for one in chargers])
    current_a, load_w = _first(monitors, lambda one: one.current_a), output_w
    if current_a is not None and voltage_v is not None and solar_w is not None:
        load_w = solar_w - voltage_v * current_a
    elif current_a is None and output_w is not None:
        current_a = _sum([one.current_a for one in chargers])
    return Supply(
        voltage_v,
        current_a,
        _first(monitors, lambda one: one.charge),
        _first(monitors, lambda one: one.temperature_c),
        solar_w,
        load_w,
    )


def update(state: PowerMonitorState, samples: Sequence[PowerSample]) -> PowerMonitorState:
    """Take samples in, in the order in which they have come, and what has flowed by then."""
    for sample in samples:
        newest: list[PowerSample | None] = list(state.samples)
        newest[sample.source] = sample
        now_s, before_s = sample.t_s, state.updated_s
        state = replace(state, samples=(newest[0], newest[1], newest[2]), updated_s=now_s)
        if before_s is None or not 0.0 < now_s - before_s <= FRESH_S:
            continue
        known, step_s = supply(state, now_s), now_s - before_s
        battery_w = known.battery_w
        state = replace(
            state,
            solar=_flown(state.solar, known.solar_w, step_s),
            load=_flown(state.load, known.load_w, step_s),
            charged=_flown(state.charged, None if battery_w is None else max(0.0, battery_w), step_s),
            discharged=_flown(state.discharged, None if battery_w is None else max(0.0, -battery_w), step_s),
        )
    return state


def silent(state: PowerMonitorState, now_s: float) -> bool:
    """Whether one who was heard says nothing any more."""
    return state.updated_s is not None and any(one is not None and now_s - one.t_s > FRESH_S for one in state.samples)


def report(state: PowerMonitorState, now_s: float) -> Power | None:
    """Return what log and link show; None when nobody has ever measured anything."""
    if state.updated_s is None:
        return None
    known = supply(state, now_s)
    return Power(
        known.voltage_v,
        known.current_a,
        known.charge,
        known.temperature_c,
        known.solar_w,
        known.load_w,
        state.solar,
        state.load,
        state.charged,
        state.discharged,
    )


def _flown(flow: Flow, power_w: float | None, step_s: float) -> Flow:
    return flow if power_w is None else Flow(flow.energy_j + power_w * step_s, flow.measured_s + step_s)


def _given_w(charger: PowerSample) -> float | None:
    """Return what a charger puts out: finer than the power of its panels, which it tells in whole watts."""
    if charger.voltage_v is None or charger.current_a is None:
        return charger.solar_w
    return max(0.0, charger.voltage_v * (charger.current_a + (charger.load_a or 0.0)))


def _output_w(charger: PowerSample) -> float | None:
    """Return what a charger's load output takes."""
    return None if charger.voltage_v is None or charger.load_a is None else charger.voltage_v * charger.load_a


def _first(samples: Sequence[PowerSample], read: Callable[[PowerSample], float | None]) -> float | None:
    return next((value for one in samples if (value := read(one)) is not None), None)


def _sum(values: Sequence[float | None]) -> float | None:
    """Return the sum of values, None when one is not known or there is none."""
    known = [value for value in values if value is not None]
    return sum(known) if known and len(known) == len(values) else None
