"""Registers of the Dynamixel: blocks, goals, telemetry, error texts."""

import math

import pytest

from firmware_py.actuator import dynamixel_registers as table

COUNT_RAD = math.radians(360.0 / 4096)


def test_blocks_have_different_lengths():
    blocks = [table.SETTINGS, table.LIMITS, table.STATE, table.WATCHDOG, table.TELEMETRY, *table.GOAL_READS]
    blocks.append(table.COMBINED)
    lengths = [block.length for block in blocks]
    assert len(set(lengths)) == len(blocks)
    assert 3 not in lengths  # a ping
    assert 0 not in lengths  # a write


def test_combined_block_contains_the_separate_blocks():
    combined = bytes(range(table.COMBINED.address, table.COMBINED.address + table.COMBINED.length))
    for block in (table.STATE, table.WATCHDOG, table.GOAL_AND_TELEMETRY, table.TELEMETRY):
        separate = bytes(range(block.address, block.address + block.length))
        assert table.extract_block(combined, block) == separate
    assert table.extract_telemetry(combined)[0] == table.TELEMETRY.address
    assert table.extract_goal(combined) == int.from_bytes(bytes(range(116, 120)), "little")


def test_registers_are_within_their_blocks():
    for register in vars(table).values():
        if isinstance(register, table.Register):
            end = register.block.address + register.block.length
            assert register.block.address <= register.address <= end - register.size, register.name


@pytest.mark.parametrize(
    ("angle_deg", "counts"), [(0.0, 2048), (0.087890625, 2049), (-90.0, 1024), (45.0, 2560), (180.0, 4095), (-180.0, 0)]
)
def test_counts_of_a_goal(angle_deg, counts):
    assert table.goal_counts(math.radians(angle_deg), {}) == counts


@pytest.mark.parametrize(
    ("maximum", "minimum", "counts"),
    [(100, 200, 2150), (0xFFFFFFFF, 0, 4095), (200, 200, 200)],
    ids=["contradictory", "beyond a turn", "one position"],
)
def test_only_possible_limits_are_used(maximum, minimum, counts):
    image = {table.LIMITS: maximum.to_bytes(4, "little") + minimum.to_bytes(4, "little")}
    assert table.goal_counts(9.0 if counts == 4095 else 102 * COUNT_RAD, image) == counts


def telemetry(current=0, position=2048, voltage=120, temperature=30):
    data = bytearray(21)
    data[0:2] = current.to_bytes(2, "little", signed=True)
    data[6:10] = position.to_bytes(4, "little", signed=True)
    data[18:20] = voltage.to_bytes(2, "little")
    data[20:21] = temperature.to_bytes(1, "little", signed=True)
    return bytes(data)


def test_values_of_telemetry():
    values = table.decode_telemetry(telemetry(current=-100, position=1024, voltage=118, temperature=-3))
    assert values.shaft_rad == pytest.approx(math.radians(-90.0), abs=1e-12)
    assert values.current_a == pytest.approx(-0.269)
    assert values.voltage_v == pytest.approx(11.8)
    assert values.temperature_c == -3.0
    assert values.invalid_values == 0


@pytest.mark.parametrize(
    ("name", "limits"),
    [("current", (-3000, 3000)), ("position", (-1024, 5120)), ("voltage", (0, 400)), ("temperature", (-40, 125))],
)
def test_telemetry_out_of_range_is_none(name, limits):
    for value in limits:
        assert table.decode_telemetry(telemetry(**{name: value})).invalid_values == 0
    for value in (limits[0] - 1, limits[1] + 1):
        if name == "voltage" and value < 0:
            continue  # the register is unsigned
        values = table.decode_telemetry(telemetry(**{name: value}))
        assert values.invalid_values == 1
        assert [values.current_a, values.shaft_rad, values.voltage_v, values.temperature_c].count(None) == 1


def test_setting_changes_only_the_masked_bits():
    assert table.Setting(table.DRIVE_MODE, 0, mask=0x0C).corrected_value(0x0D) == 0x01
    assert table.Setting(table.RETURN_DELAY, 0).corrected_value(250) == 0


def test_names_of_hardware_errors():
    assert table.hardware_error_text(0x24) == "overheating, overload"
    assert table.hardware_error_text(0x41) == "input voltage, unknown 0x40"
