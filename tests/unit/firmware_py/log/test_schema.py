import json
import struct

import msgspec
import pytest
from msgspec.structs import replace

from firmware_py.common.intents import Arm, Request
from firmware_py.common.records import (
    DeviceHealth,
    HeadingSample,
    Inputs,
    PositionSample,
    PowerSample,
    RudderAngleSample,
    RudderCommand,
    RudderFeedback,
    Tick,
)
from firmware_py.common.vessels import VesselPosition
from firmware_py.faults.table import Fault
from firmware_py.log import ardupilot, derived_records, schema, thin
from support.link import SNAPSHOT

ALL_TYPES = (*schema.TYPES, *ardupilot.TYPES)


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
        (schema.RUDDER_ANGLE, RudderAngleSample),
        (schema.CONTROL, RudderCommand),
    ],
)
def test_every_field_of_a_logged_record_has_a_column(row, record):
    fields = {name for name, _ in row.fields} | ({"text"} if row.text else set())
    assert fields == {field.name for field in msgspec.structs.fields(record)}
    assert row.make is record


def test_inputs_have_only_fields_that_are_logged():
    names = ["tick", "headings", "positions", "rudder", "devices", "requests", "power", "vessels"]
    names += ["rudder_angles", "wind", "depth"]
    assert [field.name for field in msgspec.structs.fields(Inputs)] == names


def test_message_types_are_distinct_and_start_with_the_time():
    assert len({kind.number for kind in ALL_TYPES}) == len({kind.name for kind in ALL_TYPES}) == len(ALL_TYPES)
    for kind in ALL_TYPES:
        # Codes of ArduPilot logs: Q is uint64, s is seconds, F is a factor of 1e-6.
        assert kind.labels.startswith("TimeUS,")
        assert (kind.values[0], kind.units[0], kind.multipliers[0]) == ("Q", "s", "F")


def test_inputs_and_commands_are_doubles():
    inputs = schema.TICK, schema.HEADING, schema.POSITION, schema.FEEDBACK, schema.DEVICE, schema.RUDDER_ANGLE
    for row in (*inputs, schema.CONTROL):
        assert "f" not in row.type.values


def test_the_checksum_covers_the_records_and_the_sequence_number():
    checksums = {schema.append_end(*tick)[-4:] for tick in ((b"abc", 1.0, 1), (b"abc", 1.0, 2), (b"abd", 1.0, 1))}
    assert len(checksums) == 3
    assert schema.END.values[-1] == "I"  # the checksum is the last column


def test_requests_have_the_version_that_earlier_programs_read():
    request = Request(1.0, Arm(armed=True), 255, 190)
    fields = json.loads(schema.encode_request(request))
    intent = fields.pop("intent")
    assert (fields, intent["armed"]) == ({"version": 2, "t_s": 1.0, "system": 255, "component": 190}, True)


FAULTS = """
    COMPASS_LOST POSITION_LOST RUDDER_SILENT RUDDER_ERROR LOOP_LATE STORAGE_FAILING CURRENT_STRONG MISSION_UNUSABLE
    FENCE_BREACHED COMPASS_SILENT COMPASS_FROZEN COMPASS_JUMPING COMPASS_DISAGREES POSITION_JUMPING RUDDER_ASTRAY
    RUDDER_JAMMED RUDDER_HOT RUDDER_OVERLOADED RUDDER_REPOWERED SUPPLY_LOW STORAGE_FULL CLOCK_STEPPED STATION_SILENT
    STEERING_LOST KEY_LOST HELM_OSCILLATES BATTERY_LOW BATTERY_CRITICAL POWER_SILENT STEERING_REVERSED VESSEL_NEAR
"""


def test_fault_bits_are_those_of_earlier_versions_and_fit_their_column():
    assert [fault.name for fault in Fault][: len(FAULTS.split())] == FAULTS.split()  # a new fault is the last
    for row in (schema.CONTROL, thin.SAILING):
        labels, values = row.type.labels.split(","), row.type.values
        assert struct.calcsize(f"<{values[labels.index('Flt')]}") * 8 >= len(Fault)


@pytest.mark.parametrize(("estimate_rad", "count"), [(None, 0), (0.1, 1)])
def test_estimated_rudder_angle_is_logged_in_every_tick(estimate_rad, count):
    for tick in (10, 11):
        snapshot = replace(SNAPSHOT, tick=tick, rudder_rad=None, rudder_estimate_rad=estimate_rad)
        data = derived_records.encode_snapshot(snapshot)
        row = derived_records.RUDDER_ESTIMATE.pack(snapshot.t_s, replace(snapshot, rudder_estimate_rad=0.1))
        assert data.count(row) == count
