"""Conditions of the faults at their limits; tests/process/test_faults.py provokes each fault in the program."""

import pytest
from msgspec.structs import replace

from firmware_py.common.parameter_table import INDEX
from firmware_py.common.records import DeviceState
from firmware_py.faults.latch import judge_conditions
from firmware_py.faults.row import FaultInput
from firmware_py.faults.table import TABLE, Fault

VALUES = {
    "faults": 0,
    "servo_temperature_c": 30.0, "servo_hot_c": 70.0,
    "supply_v": 12.0, "supply_low_v": 11.0,
    "battery_charge": 0.8, "battery_v": 12.8,
    "save_charge": 0.3, "save_v": 12.0, "keep_charge": 0.1, "keep_v": 11.5,
    **dict.fromkeys(("storage", "clock", "key", "station"), DeviceState.RUNNING),
    "station_age_s": 0.5, "station_timeout_s": 600.0,
    "late_age_s": None, "servo_restart_age_s": None,
    "depth_m": 50.0, "depth_min_m": 20.0, "wind_m_s": 8.0, "wind_max_m_s": 15.0,
}  # fmt: skip
NORMAL = FaultInput(**dict.fromkeys(FaultInput.__struct_fields__, False) | VALUES)


def present_faults(**changes):
    return [
        fault
        for fault, is_present in zip(TABLE, judge_conditions(replace(NORMAL, **changes)), strict=True)
        if is_present
    ]


def test_no_condition_is_present_in_normal_operation_or_without_data():
    assert present_faults() == []
    missing = (
        "depth_m",
        "wind_m_s",
        "servo_temperature_c",
        "supply_v",
        "battery_charge",
        "battery_v",
        "storage",
        "clock",
        "station",
    )
    assert present_faults(**dict.fromkeys(missing)) == []


@pytest.mark.parametrize(
    ("fault", "absent", "present"),
    [
        (Fault.COMPASS_LOST, {"heading_old": False}, {"heading_old": True}),
        (Fault.VESSEL_NEAR, {"vessel_near": False}, {"vessel_near": True}),
        (Fault.POSITION_LOST, {"position_old": False}, {"position_old": True}),
        (Fault.RUDDER_SILENT, {"servo_old": False}, {"servo_old": True}),
        (Fault.LOOP_LATE, {"late_age_s": 2.01}, {"late_age_s": 2.0}),
        (Fault.RUDDER_REPOWERED, {"servo_restart_age_s": 5.01}, {"servo_restart_age_s": 5.0}),
        (Fault.RUDDER_HOT, {"servo_temperature_c": 70.0}, {"servo_temperature_c": 70.1}),
        (Fault.SUPPLY_LOW, {"supply_v": 11.0}, {"supply_v": 10.9}),
        (Fault.BATTERY_LOW, {"battery_charge": 0.3}, {"battery_charge": 0.299}),
        (Fault.BATTERY_LOW, {"battery_v": 12.0}, {"battery_v": 11.99}),
        (Fault.WATER_SHALLOW, {"depth_m": 20.0}, {"depth_m": 19.99}),
        (Fault.WIND_STRONG, {"wind_m_s": 15.0}, {"wind_m_s": 15.01}),
        (Fault.POWER_SILENT, {"power_silent": False}, {"power_silent": True}),
        (Fault.STORAGE_FULL, {"storage": DeviceState.RUNNING}, {"storage": DeviceState.FULL}),
        (Fault.STORAGE_FAILING, {"storage": DeviceState.RUNNING}, {"storage": DeviceState.FAULTY}),
        (Fault.CLOCK_STEPPED, {"clock": DeviceState.RUNNING}, {"clock": DeviceState.FAULTY}),
        (
            Fault.STATION_SILENT,
            {"station": DeviceState.SILENT, "station_age_s": 600.0},
            {"station": DeviceState.SILENT, "station_age_s": 600.1},
        ),
    ],
)
def test_condition_is_present_beyond_its_limit(fault, absent, present):
    assert present_faults(**absent) == []
    assert present_faults(**present) == [fault]


@pytest.mark.parametrize(
    ("fault", "still_present", "cleared"),
    [
        (Fault.RUDDER_HOT, {"servo_temperature_c": 65.1}, {"servo_temperature_c": 65.0}),
        (Fault.SUPPLY_LOW, {"supply_v": 11.32}, {"supply_v": 11.34}),
        (Fault.BATTERY_LOW, {"battery_charge": 0.349}, {"battery_charge": 0.351}),
        (Fault.BATTERY_LOW, {"battery_v": 12.35}, {"battery_v": 12.37}),
        (Fault.WATER_SHALLOW, {"depth_m": 21.99}, {"depth_m": 22.01}),
        (Fault.WIND_STRONG, {"wind_m_s": 13.51}, {"wind_m_s": 13.49}),
        (Fault.BATTERY_CRITICAL, {"battery_charge": 0.149, "save_charge": 0.0}, {"battery_charge": 0.36}),
    ],
)
def test_limits_have_hysteresis_while_their_fault_is_set(fault, still_present, cleared):
    assert present_faults(**still_present) == []
    assert present_faults(**still_present, faults=1 << fault) == [fault]
    assert present_faults(**cleared, faults=1 << fault) == []


def test_full_disk_that_fails_remains_full():
    both = sum(1 << fault for fault in (Fault.STORAGE_FULL, Fault.STORAGE_FAILING))
    assert present_faults(storage=DeviceState.FAULTY) == [Fault.STORAGE_FAILING]
    assert set(present_faults(storage=DeviceState.FAULTY, faults=both)) == {Fault.STORAGE_FULL, Fault.STORAGE_FAILING}
    assert present_faults(storage=DeviceState.RUNNING, faults=both) == []


LOW_AND_CRITICAL = [Fault.BATTERY_LOW, Fault.BATTERY_CRITICAL]


def test_empty_battery_is_low_and_critical_unless_a_limit_is_zero():
    assert present_faults(battery_charge=0.05) == LOW_AND_CRITICAL
    assert present_faults(battery_charge=0.05, keep_charge=0.0, keep_v=0.0) == LOW_AND_CRITICAL[:1]
    no_limits = dict.fromkeys(("save_charge", "save_v", "keep_charge", "keep_v"), 0.0)
    assert present_faults(battery_charge=0.0, battery_v=0.0, **no_limits) == []


def test_battery_faults_remain_set_without_data_until_their_limits_are_zero():
    both = sum(1 << fault for fault in LOW_AND_CRITICAL)
    unknown = {"battery_charge": None, "battery_v": None}
    assert present_faults(**unknown, faults=both) == LOW_AND_CRITICAL
    assert present_faults(**unknown, faults=both, save_charge=0.0, save_v=0.0) == LOW_AND_CRITICAL[1:]
    assert present_faults(**unknown, faults=both, save_charge=0.0, keep_v=0.0) == LOW_AND_CRITICAL
    assert present_faults(battery_charge=None, faults=both) == []  # the voltage is normal


@pytest.mark.parametrize(
    ("fault", "value", "limit"),
    [(Fault.WATER_SHALLOW, "depth_m", "depth_min_m"), (Fault.WIND_STRONG, "wind_m_s", "wind_max_m_s")],
)
def test_depth_and_wind_faults_remain_set_without_data_until_their_limit_is_zero(fault, value, limit):
    bit = 1 << fault
    assert present_faults(**{value: None}) == []
    assert present_faults(**{value: None}, faults=bit) == [fault]
    assert present_faults(**{value: None, limit: 0.0}, faults=bit) == []
    for extreme in (0.0, 100.0):
        assert present_faults(**{value: extreme, limit: 0.0}) == []
        assert present_faults(**{value: extreme, limit: 0.0}, faults=bit) == []


def test_age_alone_does_not_make_a_ground_station_silent():
    assert present_faults(station_age_s=1e6) == []


def test_parameters_of_the_table_exist():
    assert all(row.parameter in INDEX for row in TABLE.values() if row.parameter)
