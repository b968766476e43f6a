"""Age of heading, position and servo feedback."""

import pytest
from msgspec.structs import replace

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, PositionSample, RudderFeedback
from firmware_py.core.device_reports import DeviceReports
from firmware_py.core.freshness import Age, Freshness, age_of
from firmware_py.core.rudder import RudderState
from firmware_py.core.state import State, freshness_of, heading_timeouts_of, settings_of
from firmware_py.core.tick_timing import TickTiming
from firmware_py.estimate.position import PositionState


@pytest.mark.parametrize(
    ("t_s", "started_s", "age"),
    [
        (9.0, 0.0, Age.FRESH),
        (8.99, 0.0, Age.OLD),
        (None, None, Age.AWAITED),
        (None, 9.0, Age.AWAITED),
        (None, 8.99, Age.OLD),  # a missing value is measured from the start
        (10.5, 0.0, Age.FRESH),
    ],
)
def test_age_depends_on_the_timeout(t_s, started_s, age):
    assert age_of(t_s, started_s, 10.0, 1.0) is age


def test_each_value_has_its_own_timeout():
    parameters = ParameterSet().replaced("CMP_TIMEOUT_S", 2.0).replaced("POS_TIMEOUT_S", 9.0)
    state = State.at_start(parameters.replaced("RUD_TIMEOUT_S", 4.0))
    settings = settings_of(state.parameters)
    timeouts = heading_timeouts_of(settings, state.devices)
    assert freshness_of(settings, state, timeouts, 100.0) == Freshness(Age.AWAITED, Age.AWAITED, Age.AWAITED)
    state = replace(
        state,
        timing=TickTiming(started_s=0.0),
        devices=DeviceReports(position_interval_s=0.1, rudder_interval_s=0.1),
        position=PositionState(fix=PositionSample(5.0, FixType.FIX_3D, 0.5, 0.5)),
        rudder=RudderState(feedback=RudderFeedback(5.0)),
    )
    timeouts = heading_timeouts_of(settings, state.devices)
    assert freshness_of(settings, state, timeouts, 1.0).heading is Age.AWAITED
    assert freshness_of(settings, state, timeouts, 9.0) == Freshness(Age.OLD, Age.FRESH, Age.FRESH)
    assert freshness_of(settings, state, timeouts, 10.0) == Freshness(Age.OLD, Age.FRESH, Age.OLD)
    assert freshness_of(settings, state, timeouts, 15.0) == Freshness(Age.OLD, Age.OLD, Age.OLD)
