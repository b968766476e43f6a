"""Rows of the parameter table: types, limits and rejected values."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.parameter_row import (
    Kind,
    ParameterError,
    choice,
    constant,
    count,
    integer,
    real,
    to_single,
)
from firmware_py.common.parameter_table import TABLE
from support.stored_numbers import assert_mavlink_numbers


def rows():
    return {
        row.name: row
        for row in (
            real("LENGTH", 0.1, -0.7, 0.3, "m", "Length."),
            integer("NUMBER", 2, -3, 1_000_000, "", "Number."),
            choice("SWITCH", 3, {0: "off", 3: "on"}, "Switch."),
            constant("FIXED", 1, "all", "Constant."),
            count("COUNTER", "Counter."),
        )
    }


def test_types_are_those_of_mavlink():
    assert_mavlink_numbers(Kind, "MAV_PARAM_TYPE_{}", INTEGER="INT32", REAL="REAL32")


@pytest.mark.parametrize(
    ("name", "valid", "invalid", "reason"),
    [
        ("LENGTH", (-0.7, 0.1, 0.3), (-0.71, 0.301), "out of range; allowed: -0.7 to 0.3 m"),
        ("NUMBER", (-3, 2, 1_000_000), (-4, 1_000_001), "out of range; allowed: -3 to 1e"),
        ("NUMBER", (), (0.5,), "0.5 is not a whole number; allowed: -3 to 1e"),
        ("SWITCH", (0, 3), (1, 2), r"is not one of its values; allowed: 0 \(off\), 3 \(on\)"),
        ("SWITCH", (), (-1, 4), "out of range"),
        ("FIXED", (1,), (0, 2), r"out of range; allowed: 1 \(all\)"),
        ("COUNTER", (0, 1_000_000), (-1, 1_000_001), "out of range"),
    ],
)
def test_values_of_a_row(name, valid, invalid, reason):
    row = rows()[name]
    assert row.check(row.default) == row.default
    assert [row.check(value) for value in valid] == [to_single(value) for value in valid]
    for value in invalid:
        with pytest.raises(ParameterError, match=f"^{name}: .*{reason}"):
            row.check(value)


def test_rows_have_their_defaults_and_may_be_changed_unless_counted_or_constant():
    assert [row.default for row in rows().values()] == [to_single(0.1), 2, 3, 1, 0]
    assert [(row.read_only, row.reboot) for row in rows().values()] == [(False, False)] * 3 + [(True, False)] * 2
    restarts = (
        real("A", 0.0, 0.0, 1.0, "", "", reboot=True),
        integer("B", 0, 0, 1, "", "", reboot=True),
        choice("C", 0, {0: "off"}, "", reboot=True),
    )
    assert all(row.reboot and not row.read_only for row in restarts)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, -1e300, 3.5e38])
def test_values_that_no_parameter_can_have_are_rejected(value):
    for row in TABLE:
        with pytest.raises(ParameterError, match=row.name):
            row.check(value)


@given(st.sampled_from(TABLE), st.floats(allow_nan=False, allow_infinity=False))
def test_stored_values_are_singles_in_range(row, value):
    try:
        stored = row.check(value)
    except ParameterError:
        return
    assert to_single(row.minimum) <= stored <= to_single(row.maximum)
    assert struct.unpack("<f", struct.pack("<f", stored))[0] == stored
    if row.kind is Kind.INTEGER:
        assert stored == int(stored)
