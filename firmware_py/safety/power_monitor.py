"""State of battery and panels, combined from all power monitors and chargers, and the energy that has flowed.

A monitor measures the whole current of the battery, a charger only its own. So voltage and current of the battery are
those of the first monitor, that of the boat before that of another component; without a monitor, those of a charger
with the loads on its load output. The power of the panels is the output of the chargers; that of the loads is the same
less the power into the battery.

Energy is the integral of power over the time between samples; the time for which the power is known is counted, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.records import PowerSample
from firmware_py.common.reports import Flow, Power

FRESH_S: Final = 15.0  # another component may send only once in 5 s
COMPANION: Final = 2  # PowerSample.source of another MAVLink component
Samples = tuple[PowerSample | None, PowerSample | None, PowerSample | None]


class PowerMonitorState(msgspec.Struct, frozen=True):
    """Newest sample of each source, time of the newest one, and energies since the start."""

    samples: Samples = (None, None, None)
    updated_s: float | None = None
    solar: Flow = Flow()
    load: Flow = Flow()
    charged: Flow = Flow()
    discharged: Flow = Flow()


class Supply(msgspec.Struct, frozen=True):
    """State of battery, panels and loads; None: not measured; a current into the battery is positive."""

    voltage_v: float | None = None
    current_a: float | None = None
    charge: float | None = None
    temperature_c: float | None = None
    solar_w: float | None = None
    load_w: float | None = None

    @property
    def battery_w(self) -> float | None:
        """Power into the battery [W]."""
        if self.voltage_v is None or self.current_a is None:
            return None
        return self.voltage_v * self.current_a


UNKNOWN: Final = Supply()


def supply(state: PowerMonitorState, now_s: float) -> Supply:
    """Return the state of the supply from the samples of the last FRESH_S."""
    if state.updated_s is None:
        return UNKNOWN
    fresh = [one for one in state.samples if one is not None and now_s - one.t_s <= FRESH_S]
    chargers = [one for one in fresh if one.solar_w is not None]
    monitors = [one for one in fresh if one.solar_w is None]
    voltage_v = _first(monitors, lambda one: one.voltage_v)
    if voltage_v is None:
        voltage_v = _first(chargers, lambda one: one.voltage_v)
    solar_w = _sum([_charger_output_w(one) for one in chargers])
    output_w = _sum([_load_output_w(one) for one in chargers])
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
    """Return the state after samples, in the order of their arrival, with the energies up to then."""
    for sample in samples:
        newest: list[PowerSample | None] = list(state.samples)
        newest[sample.source] = sample
        now_s, before_s = sample.t_s, state.updated_s
        state = replace(state, samples=(newest[0], newest[1], newest[2]), updated_s=now_s)
        if before_s is None or not 0.0 < now_s - before_s <= FRESH_S:
            continue
        present, step_s = supply(state, now_s), now_s - before_s
        battery_w = present.battery_w
        state = replace(
            state,
            solar=_integrated(state.solar, present.solar_w, step_s),
            load=_integrated(state.load, present.load_w, step_s),
            charged=_integrated(state.charged, None if battery_w is None else max(0.0, battery_w), step_s),
            discharged=_integrated(state.discharged, None if battery_w is None else max(0.0, -battery_w), step_s),
        )
    return state


def has_silent_source(state: PowerMonitorState, now_s: float) -> bool:
    """Return whether a source that has sent samples is silent."""
    return state.updated_s is not None and any(one is not None and now_s - one.t_s > FRESH_S for one in state.samples)


def report(state: PowerMonitorState, now_s: float) -> Power | None:
    """Return the report for log and link; None before the first sample."""
    if state.updated_s is None:
        return None
    present = supply(state, now_s)
    return Power(
        present.voltage_v,
        present.current_a,
        present.charge,
        present.temperature_c,
        present.solar_w,
        present.load_w,
        state.solar,
        state.load,
        state.charged,
        state.discharged,
    )


def _integrated(flow: Flow, power_w: float | None, step_s: float) -> Flow:
    return flow if power_w is None else Flow(flow.energy_j + power_w * step_s, flow.measured_s + step_s)


def _charger_output_w(charger: PowerSample) -> float | None:
    """Return the output of a charger from voltage and current; the power of its panels is rounded to whole watts."""
    if charger.voltage_v is None or charger.current_a is None:
        return charger.solar_w
    return max(0.0, charger.voltage_v * (charger.current_a + (charger.load_a or 0.0)))


def _load_output_w(charger: PowerSample) -> float | None:
    """Return the power of the load output of a charger."""
    return None if charger.voltage_v is None or charger.load_a is None else charger.voltage_v * charger.load_a


def _first(samples: Sequence[PowerSample], read: Callable[[PowerSample], float | None]) -> float | None:
    return next((value for one in samples if (value := read(one)) is not None), None)


def _sum(values: Sequence[float | None]) -> float | None:
    """Return the sum of values; None if one is not known or there is none."""
    known = [value for value in values if value is not None]
    return sum(known) if known and len(known) == len(values) else None
