"""Numbers of enumerations: those of MAVLink, and those that logs and state files contain."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firmware_py.common.intents import Verdict
from firmware_py.common.mode_table import BaseMode, Mode, Need, RudderBy, StandardMode
from firmware_py.common.parameter_row import Kind
from firmware_py.common.plan import PlanKind
from firmware_py.common.records import (
    CalibrationState,
    DeviceRole,
    DeviceState,
    FixType,
    NorthReference,
    Severity,
    WindReference,
)
from firmware_py.common.reports import Activity, MissionState
from firmware_py.common.vessels import VesselKind
from firmware_py.plans.problem import PlanResult


@pytest.mark.parametrize(
    ("kind", "name", "exceptions"),
    [
        (Verdict, "MAV_RESULT_{}", {}),
        (PlanKind, "MAV_MISSION_TYPE_{}", {}),
        (PlanResult, "MAV_MISSION_{}", {}),
        (MissionState, "MISSION_STATE_{}", {}),
        (Severity, "MAV_SEVERITY_{}", {}),
        (Mode, "ROVER_MODE_{}", {}),
        (BaseMode, "MAV_MODE_FLAG_{}_ENABLED", {}),
        (StandardMode, "MAV_STANDARD_MODE_{}", {"NONE": "MAV_STANDARD_MODE_NON_STANDARD"}),
        (Kind, "MAV_PARAM_TYPE_{}", {"INTEGER": "MAV_PARAM_TYPE_INT32", "REAL": "MAV_PARAM_TYPE_REAL32"}),
        (
            FixType,
            "GPS_FIX_TYPE_{}",
            {"NONE": "GPS_FIX_TYPE_NO_FIX", "FIX_2D": "GPS_FIX_TYPE_2D_FIX", "FIX_3D": "GPS_FIX_TYPE_3D_FIX"},
        ),
    ],
)
def test_numbers_are_those_of_mavlink(kind, name, exceptions):
    for member in kind:
        assert member == getattr(mavlink, exceptions.get(member.name, name.format(member.name))), member


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (
            DeviceRole,
            "COMPASS POSITION RUDDER STORAGE LINK CLOCK COMPASS_B KEY POWER POWER_B AIS RUDDER_ANGLE WIND DEPTH",
        ),
        (DeviceState, "ABSENT STARTING RUNNING SILENT FAULTY FULL FAILED"),
        (CalibrationState, "NONE RUNNING DONE FAILED"),
        (NorthReference, "TRUE MAGNETIC RELATIVE"),
        (WindReference, "NORTH MAGNETIC APPARENT BOW BOW_WATER"),
        (VesselKind, "CLASS_A CLASS_B BASE_STATION MARK"),
        (Activity, "NOTHING HEADING LINE STATION CIRCLE"),
        (Need, "HEADING POSITION MISSION HOME"),
        (RudderBy, "NOTHING STICK HEADING"),
    ],
)
def test_stored_numbers_do_not_change(kind, names):
    assert {member.name: member.value for member in kind} == {name: n for n, name in enumerate(names.split())}
