"""Outputs of NMEA 0183 after each tick, and the declination of their sentences."""

import math
from types import SimpleNamespace

import pytest
from msgspec.structs import replace

from firmware_py.assemble.nmea_outputs import connect_nmea_outputs, declination_rad
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.common.records import RudderCommand
from firmware_py.common.reports import Output
from firmware_py.core.state import State
from support.link import SNAPSHOT


def make_state(model_deg, **parameters):
    values = ParameterSet()
    for name, value in parameters.items():
        values = values.replaced(name, value)
    state = State.at_start(values, Plans())
    declination = replace(
        state.heading_estimator.declination, declination_rad=None if model_deg is None else math.radians(model_deg)
    )
    return replace(state, heading_estimator=replace(state.heading_estimator, declination=declination))


@pytest.mark.parametrize(
    ("model_deg", "parameters", "expected_deg"),
    [
        (-7.0, {"CMP_DECL_AUTO": 1, "CMP_DECL_DEG": 5}, -7.0),
        (-7.0, {"CMP_DECL_AUTO": 0, "CMP_DECL_DEG": 5}, 5.0),
        (None, {"CMP_DECL_AUTO": 1, "CMP_DECL_DEG": 5}, 5.0),
    ],
)
def test_declination_is_that_of_the_model_if_it_is_selected_and_known(model_deg, parameters, expected_deg):
    state = make_state(model_deg, **parameters)
    assert declination_rad(state) == pytest.approx(math.radians(expected_deg))
    assert state.parameters["CMP_DECL_DEG"] == 5


def test_each_tick_is_sent_to_all_outputs_and_passed_on():
    calls = []

    class NmeaOutput:
        def publish(self, create_data, now_s):
            data = create_data()
            calls.append((data.snapshot is SNAPSHOT, data.utc_s, round(math.degrees(data.declination_rad)), now_s))

    def call(now_s, function):
        calls.append(now_s)
        function()

    parts = SimpleNamespace(
        after_tick=lambda output, now_s: calls.append((output.snapshot is SNAPSHOT, now_s)),
        clock=SimpleNamespace(utc_s=lambda: 1.79e9),
        autopilot=SimpleNamespace(state=make_state(None, CMP_DECL_DEG=5)),
        fault_barrier=SimpleNamespace(call=call),
    )
    plain = parts.after_tick
    connect_nmea_outputs([], parts)
    assert parts.after_tick is plain
    connect_nmea_outputs([NmeaOutput(), NmeaOutput()], parts)
    parts.after_tick(Output(RudderCommand(0.0, True), SNAPSHOT, ()), 12.5)
    assert calls == [*[12.5, (True, 1.79e9, 5, 12.5)] * 2, (True, 12.5)]
