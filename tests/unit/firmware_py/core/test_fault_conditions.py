"""Inputs of the fault conditions; faults of two compasses: frozen, jumping, disagreeing."""

import math
import random

import pytest
from msgspec.structs import replace

from firmware_py.common.angles import radians
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanKind, Plans
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, FixType, PositionSample, RudderFeedback
from firmware_py.common.vessels import Vessel, VesselKind, VesselPosition
from firmware_py.core.fault_conditions import fault_input, find_compass_faults
from firmware_py.core.freshness import Age, Freshness
from firmware_py.core.state import State, heading_timeouts_of, settings_of
from firmware_py.estimate.sources import Source, SourceState, TrueHeadingSample, add_sample, compasses_disagree, select
from firmware_py.faults.row import FaultInput
from firmware_py.guidance.fence import FenceState
from support.plans import FENCE_ITEMS

# Faults: (a compass is frozen, a compass jumps, the compasses disagree).
FROZEN, JUMPING, DISAGREE = (True, False, False), (False, True, False), (False, False, True)
NO_FAULT, JUMPING_AND_DISAGREE = (False, False, False), (False, True, True)
FROZEN_S, TIMEOUTS_S = 30.0, (1.0, 1.0)


class Compasses:
    """Two compasses at 10 Hz, and their faults."""

    def __init__(self):
        self.state, self.rng, self.ticks = SourceState(), random.Random(3), 0

    def run(self, seconds, a_deg=0.0, b_deg=0.0, *, spread_deg=0.3):
        """Run with compass headings that differ from the estimate (None: no data); return the changes of the faults."""
        reports = []
        for _ in range(round(10 * seconds)):
            expected_rad = 1.0 if self.ticks else math.nan
            self.ticks += 1
            now_s = 0.1 * self.ticks
            for source, off_deg in ((0, a_deg), (1, b_deg)):
                if off_deg is not None:
                    heading_rad = 1.0 + radians(self.rng.gauss(off_deg, spread_deg if source else 0.3))
                    sample = TrueHeadingSample(now_s, heading_rad, heading_rad, source)
                    self.state = add_sample(self.state, sample, expected_rad)
            self.state = select(self.state, now_s, FROZEN_S, TIMEOUTS_S, False)
            faults = (*find_compass_faults(FROZEN_S, self.state, TIMEOUTS_S, now_s), compasses_disagree(self.state))
            reports += [faults] if reports[-1:] != [faults] else []
        return reports


@pytest.mark.parametrize("off_deg", [16.0, 18.0, 22.0, 25.0, -24.0, 90.0])
def test_compasses_that_differ_from_the_start_disagree_without_a_jump(off_deg):
    compasses = Compasses()
    assert compasses.run(60.0, b_deg=off_deg)[-1] == DISAGREE
    assert compasses.state.in_use is Source.COMPASS_A
    assert JUMPING not in (reports := compasses.run(60.0, b_deg=off_deg))
    assert JUMPING_AND_DISAGREE not in reports
    compasses.run(20.0)
    assert compasses.run(20.0) == [NO_FAULT]


def test_compasses_that_drift_apart_disagree_without_a_jump():
    compasses = Compasses()
    compasses.run(20.0)
    reports = [compasses.run(5.0, b_deg=float(off_deg)) for off_deg in range(41)]
    assert reports[-1] == [DISAGREE]
    assert not any(JUMPING in faults or JUMPING_AND_DISAGREE in faults for faults in reports)
    compasses.run(20.0, b_deg=18.0)
    assert compasses.run(20.0, b_deg=18.0) == [DISAGREE]


def test_sudden_difference_is_a_jump_and_later_also_a_disagreement():
    compasses = Compasses()
    compasses.run(20.0)
    assert compasses.run(1.0, b_deg=22.0) == [NO_FAULT]
    assert compasses.run(60.0, b_deg=22.0) == [NO_FAULT, JUMPING, JUMPING_AND_DISAGREE]
    compasses.run(20.0)
    assert compasses.run(20.0) == [NO_FAULT]
    compasses.run(5.0, a_deg=180.0)
    assert compasses.run(5.0, a_deg=180.0) == [JUMPING_AND_DISAGREE]
    assert compasses.state.in_use is Source.COMPASS_B


def test_compass_with_random_headings_jumps():
    compasses = Compasses()
    compasses.run(20.0)
    assert any(jumping for _, jumping, _ in compasses.run(60.0, b_deg=180.0, spread_deg=80.0))


def test_compass_without_data_does_not_disagree_and_a_single_one_can_jump():
    compasses = Compasses()
    compasses.run(20.0, b_deg=25.0)
    assert compasses.run(30.0, a_deg=None, b_deg=25.0)[-1] == JUMPING
    assert compasses.run(5.0, a_deg=0.0, b_deg=None)[-1] == NO_FAULT


NOW_S = 1000.0
FENCE = Plans(fence=Plan.of(PlanKind.FENCE, FENCE_ITEMS))
FIX = PositionSample(NOW_S, FixType.FIX_3D, 0.1, 0.2)
FRESH, OLD = (Freshness(age, age, age) for age in (Age.FRESH, Age.OLD))


def health(role, device_state, t_s=NOW_S):
    return DeviceHealth(t_s, role, device_state, 0, 0)


def changed(state, **changes):
    """Return a state with changed fields; those of records in it are named with two underscores."""
    for name, value in changes.items():
        record, _, field = name.partition("__")
        if field:
            state = replace(state, **{record: replace(getattr(state, record), **{field: value})})
        else:
            state = replace(state, **{record: value})
    return state


def inputs_of(state, freshness):
    settings = settings_of(state.parameters)
    return fault_input(settings, state, freshness, heading_timeouts_of(settings, state.devices), NOW_S)


def differences(state, freshness=FRESH):
    """Return the inputs that differ from those of a boat at rest without any data."""
    normal, present = inputs_of(START, FRESH), inputs_of(state, freshness)
    values = ((name, getattr(present, name)) for name in FaultInput.__struct_fields__)
    return {name: value for name, value in values if value != getattr(normal, name)}


START = State.at_start(ParameterSet())
LOITER = replace(START.modes, mode=Mode.LOITER, armed=True)
AUTO = replace(START.modes, mode=Mode.AUTO, armed=True)
UNUSABLE = replace(START.guidance.mission, unusable=True)
TOO_STRONG, NOT_STRONG = (
    replace(START.heading_estimator, water=START.heading_estimator.water._replace(verdict=verdict))
    for verdict in (START.heading_estimator.water.verdict._replace(too_strong=value) for value in (1.0, 0.0))
)
SHIP = Vessel(VesselPosition(0.0, 1, VesselKind.CLASS_A, 0.1, 0.2), near_s=5.0)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, {}),
        ({"timing__skipped_t_s": 990.0}, {"late_age_s": 10.0}),
        ({"rudder__restarted_s": 995.0}, {"servo_restart_age_s": 5.0}),
        (
            {"rudder__feedback": RudderFeedback(NOW_S, 0.1, 30.0, 12.0)},
            {"servo_temperature_c": 30.0, "supply_v": 12.0},
        ),
        ({"rudder__feedback": RudderFeedback(NOW_S, hardware_error=4)}, {"servo_error": True}),
        ({"devices__rudder": health(DeviceRole.RUDDER, DeviceState.FAULTY)}, {"servo_error": True}),
        ({"devices__rudder": health(DeviceRole.RUDDER, DeviceState.FAILED)}, {"servo_error": True}),
        ({"devices__rudder": health(DeviceRole.RUDDER, DeviceState.SILENT)}, {}),
        ({"devices__storage": health(DeviceRole.STORAGE, DeviceState.FULL)}, {"storage": DeviceState.FULL}),
        ({"devices__clock": health(DeviceRole.CLOCK, DeviceState.FAULTY)}, {"clock": DeviceState.FAULTY}),
        ({"devices__key": health(DeviceRole.KEY, DeviceState.FAULTY)}, {"key": DeviceState.FAULTY}),
        (
            {"devices__link": health(DeviceRole.LINK, DeviceState.SILENT, 960.0)},
            {"station": DeviceState.SILENT, "station_age_s": 40.0},
        ),
        ({"devices__compass_s": (NOW_S - 2.4, NOW_S - 2.4)}, {}),  # the time-out of an unknown interval is 2.5 s
        ({"devices__compass_s": (NOW_S - 2.6, None)}, {"compass_silent": True}),
        ({"devices__compass_s": (None, NOW_S - 2.6)}, {"compass_silent": True}),
        ({"position__fix": FIX, "position__suspect": replace(FIX, t_s=NOW_S + 1.0)}, {"position_held_back": True}),
        ({"position__fix": FIX, "position__suspect": FIX}, {}),
        ({"position__suspect": FIX}, {}),
        ({"heading_estimator": TOO_STRONG}, {"current_too_strong": True}),
        ({"heading_estimator": NOT_STRONG}, {}),
        ({"modes": AUTO, "guidance__mission": UNUSABLE}, {"mission_unusable": True}),
        ({"modes": LOITER, "guidance__mission": UNUSABLE}, {}),
        ({"modes": replace(AUTO, armed=False), "guidance__mission": UNUSABLE}, {}),
        ({"traffic__vessels": (SHIP,)}, {"vessel_near": True}),
    ],
)
def test_conditions_are_read_from_the_state(changes, expected):
    assert differences(changed(START, **changes)) == expected


@pytest.mark.parametrize(
    ("margin_m", "enabled", "is_outside"), [(-0.1, True, True), (0.0, True, False), (-5.0, False, False)]
)
def test_boat_is_outside_an_enabled_fence_with_a_negative_margin(margin_m, enabled, is_outside):
    margin = FenceState(FENCE.fence.identity, object(), margin_m)
    state = changed(START, plans=FENCE, guidance__fence=margin, guidance__fence_enabled=enabled)
    assert differences(state) == ({"outside_fence": True} if is_outside else {})


OLD_VALUES = {"heading_old": True, "servo_old": True}


@pytest.mark.parametrize(
    ("changes", "position_old"),
    [
        ({"modes": LOITER, "timing__started_s": NOW_S - 180.0}, False),
        ({"modes": LOITER, "timing__started_s": NOW_S - 180.1}, True),
        ({"modes": LOITER}, False),
        ({"modes": replace(LOITER, armed=False), "timing__started_s": 0.0}, False),
        ({"modes": replace(LOITER, mode=Mode.STEERING), "timing__started_s": 0.0}, False),
        ({"position__fix": FIX}, True),
    ],
)
def test_position_is_lost_after_a_fix_or_without_a_first_fix_in_three_minutes(changes, position_old):
    """Without an earlier fix it is lost only if the mode of an armed boat needs it."""
    assert differences(changed(START, **changes), OLD) == OLD_VALUES | ({"position_old": True} if position_old else {})
    assert differences(changed(START, **changes)) == {}
