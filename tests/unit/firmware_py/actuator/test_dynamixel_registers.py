"""What the registers mean."""

import math

import pytest

from firmware_py.actuator import dynamixel_registers as table

COUNT_RAD = math.radians(360.0 / 4096)


def test_lengths_tell_the_blocks_apart():
    blocks = [
        table.SETTINGS,
        table.LIMITS,
        table.STATE,
        table.WATCHDOG,
        table.TELEMETRY,
        *table.GOAL_READS,
        table.COMBINED,
    ]
    lengths = [block.length for block in blocks]
    assert len(set(lengths)) == len(blocks)
    assert 3 not in lengths  # a ping
    assert 0 not in lengths  # a write


def test_the_combined_block_contains_the_separate_blocks():
    whole = bytes(range(table.COMBINED.address, table.COMBINED.address + table.COMBINED.length))
    for block in (table.STATE, table.WATCHDOG, table.GOAL_AND_TELEMETRY, table.TELEMETRY):
        alone = bytes(range(block.address, block.address + block.length))
        assert table.part_of(whole, block) == alone
    assert table.telemetry_of(whole)[0] == table.TELEMETRY.address
    assert table.goal_of(whole) == int.from_bytes(bytes(range(116, 120)), "little")


def test_every_register_lies_in_its_block():
    for register in vars(table).values():
        if isinstance(register, table.Register):
            end = register.block.address + register.block.length
            assert register.block.address <= register.address <= end - register.size, register.name


@pytest.mark.parametrize(
    ("angle_deg", "counts"), [(0.0, 2048), (0.087890625, 2049), (-90.0, 1024), (45.0, 2560), (180.0, 4095), (-180.0, 0)]
)
def test_goal(angle_deg, counts):
    assert table.goal_counts(math.radians(angle_deg), {}) == counts


def test_contradictory_limits_are_ignored():
    image = {table.LIMITS: (100).to_bytes(4, "little") + (200).to_bytes(4, "little")}
    assert table.goal_counts(0.0, image) == 2048


def test_limits_beyond_the_turn_do_not_widen_it():
    image = {table.LIMITS: (0xFFFFFFFF).to_bytes(4, "little") + (0).to_bytes(4, "little")}
    assert table.goal_counts(9.0, image) == 4095


def telemetry(current=0, position=2048, voltage=120, temperature=30):
    data = bytearray(21)
    data[0:2] = current.to_bytes(2, "little", signed=True)
    data[6:10] = position.to_bytes(4, "little", signed=True)
    data[18:20] = voltage.to_bytes(2, "little")
    data[20:21] = temperature.to_bytes(1, "little", signed=True)
    return bytes(data)


def test_telemetry():
    values = table.decode_telemetry(telemetry(current=-100, position=1024, voltage=118, temperature=-3))
    assert values.shaft_rad == pytest.approx(math.radians(-90.0), abs=1e-12)
    assert values.current_a == pytest.approx(-0.269)
    assert values.voltage_v == pytest.approx(11.8)
    assert values.temperature_c == -3.0
    assert values.invalid_values == 0


@pytest.mark.parametrize(
    "invalid_values",
    [
        {"current": 3001},
        {"current": -3001},
        {"position": 5121},
        {"position": -1025},
        {"voltage": 401},
        {"temperature": 126},
        {"temperature": -41},
    ],
    ids=str,
)
def test_impossible_telemetry(invalid_values):
    values = table.decode_telemetry(telemetry(**invalid_values))
    assert values.invalid_values == 1
    assert [values.current_a, values.shaft_rad, values.voltage_v, values.temperature_c].count(None) == 1


def test_masked_setting_leaves_the_rest():
    assert table.Setting(table.DRIVE_MODE, 0, mask=0x0C).corrected(0x0D) == 0x01
    assert table.Setting(table.RETURN_DELAY, 0).corrected(250) == 0


def test_names_of_hardware_errors():
    assert table.hardware_error_text(0x24) == "overheating, overload"
    assert table.hardware_error_text(0x41) == "input voltage, unknown 0x40"
