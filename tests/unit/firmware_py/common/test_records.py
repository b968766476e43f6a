"""Numbers of states and kinds, which logs, state files and MAVLink contain."""

import pytest

from firmware_py.common import records
from support.stored_numbers import assert_mavlink_numbers, assert_missing_values_are_empty, assert_stored_numbers


def test_numbers_are_those_of_mavlink():
    assert_mavlink_numbers(records.Severity, "MAV_SEVERITY_{}")
    assert_mavlink_numbers(records.FixType, "GPS_FIX_TYPE_{}", NONE="NO_FIX", FIX_2D="2D_FIX", FIX_3D="3D_FIX")


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (
            records.DeviceRole,
            "COMPASS POSITION RUDDER STORAGE LINK CLOCK COMPASS_B KEY POWER POWER_B AIS RUDDER_ANGLE WIND DEPTH",
        ),
        (records.DeviceState, "ABSENT STARTING RUNNING SILENT FAULTY FULL FAILED"),
        (records.CalibrationState, "NONE RUNNING DONE FAILED"),
        (records.NorthReference, "TRUE MAGNETIC RELATIVE"),
        (records.WindReference, "NORTH MAGNETIC APPARENT BOW BOW_WATER"),
    ],
)
def test_stored_numbers_do_not_change(kind, names):
    assert_stored_numbers(kind, names)


def test_missing_values_of_a_record_are_empty():
    assert_missing_values_are_empty(records, patience_s=15.0, alive=True)
