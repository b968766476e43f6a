import struct

import msgspec
import pytest

from firmware_py.common.records import (
    DeviceHealth,
    HeadingSample,
    Inputs,
    PositionSample,
    PowerSample,
    RudderCommand,
    RudderFeedback,
    Tick,
)
from firmware_py.common.vessels import VesselPosition
from firmware_py.faults.table import Fault
from firmware_py.log import ardupilot, schema, thin


@pytest.mark.parametrize(
    ("row", "record"),
    [
        (schema.TICK, Tick),
        (schema.HEADING, HeadingSample),
        (schema.POSITION, PositionSample),
        (schema.FEEDBACK, RudderFeedback),
        (schema.DEVICE, DeviceHealth),
        (schema.POWER, PowerSample),
        (schema.VESSEL, VesselPosition),
        (schema.CONTROL, RudderCommand),
    ],
)
def test_every_field_of_a_logged_record_has_its_column(row, record):
    kept = {name for name, _ in row.fields} | ({"text"} if row.text else set())
    assert kept == {field.name for field in msgspec.structs.fields(record)}
    assert row.make is record


def test_every_kind_of_input_is_logged():
    assert [field.name for field in msgspec.structs.fields(Inputs)] == [
        "tick",
        "headings",
        "positions",
        "rudder",
        "devices",
        "requests",
        "power",
        "vessels",
    ]


def test_numbers_and_names_are_distinct():
    types = (*schema.TYPES, *ardupilot.TYPES)
    assert len({one.number for one in types}) == len({one.name for one in types}) == len(types)


def test_every_message_begins_with_the_time_of_the_tools():
    for one in (*schema.TYPES, *ardupilot.TYPES):
        assert one.labels.startswith("TimeUS,")
        assert (one.values[0], one.units[0], one.multipliers[0]) == ("Q", "s", "F")


def test_inputs_and_decisions_are_doubles():
    for row in (schema.TICK, schema.HEADING, schema.POSITION, schema.FEEDBACK, schema.DEVICE, schema.CONTROL):
        assert "f" not in row.type.values


def test_the_checksum_covers_the_number_of_the_tick():
    assert schema.end_bytes(b"abc", 1.0, 1)[-4:] != schema.end_bytes(b"abc", 1.0, 2)[-4:]
    assert schema.end_bytes(b"abc", 1.0, 1)[-4:] != schema.end_bytes(b"abd", 1.0, 1)[-4:]
    assert schema.END.values[-1] == "I"  # the checksum is the last, over all before it


FAULTS = """
    COMPASS_LOST POSITION_LOST RUDDER_SILENT RUDDER_ERROR LOOP_LATE STORAGE_FAILING CURRENT_STRONG MISSION_UNUSABLE
    FENCE_BREACHED COMPASS_SILENT COMPASS_FROZEN COMPASS_JUMPING COMPASS_DISAGREES POSITION_JUMPING RUDDER_ASTRAY
    RUDDER_JAMMED RUDDER_HOT RUDDER_OVERLOADED RUDDER_REPOWERED SUPPLY_LOW STORAGE_FULL CLOCK_STEPPED STATION_SILENT
    STEERING_LOST KEY_LOST HELM_OSCILLATES BATTERY_LOW BATTERY_CRITICAL POWER_SILENT STEERING_REVERSED VESSEL_NEAR
"""


def test_faults_of_logs_of_any_version_are_read_by_the_same_bits():
    assert [fault.name for fault in Fault][: len(FAULTS.split())] == FAULTS.split()  # a new one goes to the end
    for row in (schema.CONTROL, thin.SAILING):
        labels, values = row.type.labels.split(","), row.type.values
        assert struct.calcsize(f"<{values[labels.index('Flt')]}") * 8 >= len(Fault)
