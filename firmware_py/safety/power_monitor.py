"""State of battery and panels from all power monitors and chargers, and energies.

A monitor measures the total current of the battery, a charger only its own. So voltage and current of the battery are
those of the first monitor (a monitor of the boat comes before that of another component) or, without a monitor, those
of a charger that also supplies the loads. The power of the panels is the output of the chargers. The power of the loads
is that minus the power into the battery.

Energy is the integral of power over the time between samples; `measured_s` is the time for which the power is known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.records import PowerSample
from firmware_py.common.reports import Flow, Power

MAX_AGE_S: Final = 15.0  # of a sample; another component may send only once in 5 s
COMPANION: Final = 2  # PowerSample.source of another MAVLink component
Samples = tuple[PowerSample | None, PowerSample | None, PowerSample | None]


class PowerMonitorState(msgspec.Struct, frozen=True):
    """Newest sample of each source, time of the newest of them, and energies since the start."""

    samples: Samples = (None, None, None)
    updated_s: float | None = None
    solar: Flow = Flow()
    load: Flow = Flow()
    charged: Flow = Flow()
    discharged: Flow = Flow()


class Supply(msgspec.Struct, frozen=True):
    """State of battery, panels and loads; None: not measured. Current into the battery is positive; charge: 0 to 1."""

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


def read_supply(state: PowerMonitorState, now_s: float) -> Supply:
    """Return the state of the supply from the samples of the last MAX_AGE_S."""
    if state.updated_s is None:
        return UNKNOWN
    recent = [sample for sample in state.samples if sample is not None and now_s - sample.t_s <= MAX_AGE_S]
    chargers = [sample for sample in recent if sample.solar_w is not None]
    monitors = [sample for sample in recent if sample.solar_w is None]
    voltage_v = _first_value(monitors, lambda sample: sample.voltage_v)
    if voltage_v is None:
        voltage_v = _first_value(chargers, lambda sample: sample.voltage_v)
    solar_w = _sum([_charger_output_w(charger) for charger in chargers])
    output_w = _sum([_load_output_w(charger) for charger in chargers])
    current_a, load_w = _first_value(monitors, lambda sample: sample.current_a), output_w
    if current_a is not None and voltage_v is not None and solar_w is not None:
        load_w = solar_w - voltage_v * current_a
    elif current_a is None and output_w is not None:
        current_a = _sum([charger.current_a for charger in chargers])
    return Supply(
        voltage_v,
        current_a,
        _first_value(monitors, lambda sample: sample.charge),
        _first_value(monitors, lambda sample: sample.temperature_c),
        solar_w,
        load_w,
    )


def update(state: PowerMonitorState, samples: Sequence[PowerSample]) -> PowerMonitorState:
    """Return the state after samples in the order of their arrival, with the energies integrated."""
    for sample in samples:
        newest: list[PowerSample | None] = list(state.samples)
        newest[sample.source] = sample
        now_s, previous_s = sample.t_s, state.updated_s
        state = replace(state, samples=(newest[0], newest[1], newest[2]), updated_s=now_s)
        if previous_s is None or not 0.0 < now_s - previous_s <= MAX_AGE_S:
            continue
        supply, step_s = read_supply(state, now_s), now_s - previous_s
        battery_w = supply.battery_w
        state = replace(
            state,
            solar=_integrate(state.solar, supply.solar_w, step_s),
            load=_integrate(state.load, supply.load_w, step_s),
            charged=_integrate(state.charged, None if battery_w is None else max(0.0, battery_w), step_s),
            discharged=_integrate(state.discharged, None if battery_w is None else max(0.0, -battery_w), step_s),
        )
    return state


def has_outdated_source(state: PowerMonitorState, now_s: float) -> bool:
    """Return whether a source has stopped sending samples."""
    return state.updated_s is not None and any(
        sample is not None and now_s - sample.t_s > MAX_AGE_S for sample in state.samples
    )


def report(state: PowerMonitorState, now_s: float) -> Power | None:
    """Return the report for log and link; None before the first sample."""
    if state.updated_s is None:
        return None
    supply = read_supply(state, now_s)
    return Power(
        supply.voltage_v,
        supply.current_a,
        supply.charge,
        supply.temperature_c,
        supply.solar_w,
        supply.load_w,
        state.solar,
        state.load,
        state.charged,
        state.discharged,
    )


def _integrate(flow: Flow, power_w: float | None, step_s: float) -> Flow:
    """Return the flow with the energy of a step added; unchanged if the power is not known."""
    return flow if power_w is None else Flow(flow.energy_j + power_w * step_s, flow.measured_s + step_s)


def _charger_output_w(charger: PowerSample) -> float | None:
    """Return the output power of a charger; from voltage and current if known, because its power has whole watts."""
    if charger.voltage_v is None or charger.current_a is None:
        return charger.solar_w
    return max(0.0, charger.voltage_v * (charger.current_a + (charger.load_a or 0.0)))


def _load_output_w(charger: PowerSample) -> float | None:
    """Return the power of the load output of a charger."""
    return None if charger.voltage_v is None or charger.load_a is None else charger.voltage_v * charger.load_a


def _first_value(samples: Sequence[PowerSample], read: Callable[[PowerSample], float | None]) -> float | None:
    return next((value for sample in samples if (value := read(sample)) is not None), None)


def _sum(values: Sequence[float | None]) -> float | None:
    """Return the sum of the values; None if one of them is not known, or if there are no values."""
    known = [value for value in values if value is not None]
    return sum(known) if known and len(known) == len(values) else None
