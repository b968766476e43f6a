"""Sets of parameter values, and parameter files."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_py.common.parameter_row import Kind, ParameterError, to_single
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import ParameterSet, format_file, format_value, parse_file, similar_names


def test_set_is_immutable_and_compared_by_value():
    base = ParameterSet()
    changed = base.replaced("CTL_K1", 33.3)
    assert base["CTL_K1"] == 40.0
    assert base.values() == tuple(value for _, value in base.items())
    assert changed["CTL_K1"] == to_single(33.3)
    assert changed != base
    assert changed.replaced("CTL_K1", 40.0) == base
    assert hash(changed.replaced("CTL_K1", 40.0)) == hash(base)
    assert changed.replaced("CTL_K1", 33.3) is changed  # a comparison by identity shows no change
    with pytest.raises(ParameterError, match="1 values for"):
        ParameterSet([1.0])


def test_unknown_name_is_rejected_with_similar_names():
    with pytest.raises(ParameterError, match=r"CTL_K3.*CTL_K1"):
        ParameterSet().replaced("CTL_K3", 1.0)
    assert similar_names("ctl_k3") == ("CTL_K1", "CTL_K2", "CTL_HOLD_S")
    assert similar_names("CTL_K") == ("CTL_K1", "CTL_K2", "CTL_HOLD_S")
    assert similar_names("LIMIT_DEG")[0] == "RUD_LIMIT_DEG"
    # The first 16 characters are compared.
    assert similar_names("ZZZZZZ_LIMIT_DEG") == similar_names("Z_LIMIT_DEG")
    assert similar_names("ZZZZZZZ_LIMIT_DEG") == similar_names("Z_LIMIT_DE")


@given(st.lists(st.tuples(st.sampled_from(TABLE), st.floats(0.0, 1.0)), max_size=20))
def test_parameter_file_is_written_and_read(choices):
    values = {}
    for row, fraction in choices:
        value = row.minimum + fraction * (row.maximum - row.minimum)
        try:
            values[row.name] = row.check(float(round(value)) if row.kind is Kind.INTEGER else value)
        except ParameterError:
            continue
    assert parse_file(format_file(values), "x") == values


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
@example(3.4025001647762064e38)
def test_formatted_values_are_exact_in_single_precision(value):
    assert to_single(float(format_value(value))) == value


@pytest.mark.parametrize(
    ("value", "text"),
    [(5.0, "5"), (-3.0, "-3"), (2.5, "2.5"), (to_single(0.1), "0.1"), (to_single(1 / 3), "0.33333334"),
     (999_999_936.0, "999999936"), (1e9, "1e+09"), (-1e9, "-1e+09"), (to_single(1e-30), "1e-30"),
     (to_single(16777216.1), "16777216"), (3.4028234663852886e38, "3.4028234663852886e+38")],
)  # fmt: skip
def test_values_are_written_with_the_fewest_digits(value, text):
    assert format_value(value) == text


def test_formats_of_ground_stations():
    text = "# from QGroundControl\n1\t1\tCTL_K1\t41\t9\nCTL_K2 0.5\nLOOP_RATE_HZ,20\n\n"
    assert parse_file(text, "x") == {"CTL_K1": 41.0, "CTL_K2": 0.5, "LOOP_RATE_HZ": 20.0}


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("CTL_K1", "NAME VALUE"),
        ("CTL_K1 1 2", "NAME VALUE"),
        ("1 1 CTL_K1 1", "NAME VALUE"),
        ("1 1 CTL_K1 1 9 9", "NAME VALUE"),
        ("x" * 61, f"found '{'x' * 60}'"),
        ("CTL_K1 " + "y" * 31, f"'{'y' * 30}' is not a number"),
        ("N" * 31 + " 1", f"unknown parameter '{'N' * 30}'"),
        ("CTL_K1 forty", "not a number"),
        ("CTL_KK 1", "unknown parameter"),
        ("CTL_K1 1e300", "out of range"),
        ("CTL_K1 nan", "not a number"),
    ],
)
def test_invalid_line_is_reported_with_its_number(line, reason):
    with pytest.raises(ParameterError, match=rf"boat.param:2: .*{reason}"):
        parse_file(f"CTL_K2 0.3\n{line}\n", "boat.param")


def test_twenty_problems_of_a_file_are_reported():
    with pytest.raises(ParameterError) as raised:
        parse_file("NONE 1\n" * 30, "boat.param")
    lines = str(raised.value).splitlines()
    assert [line.split(":")[1] for line in lines[:-1]] == [str(number) for number in range(1, 21)]
    assert lines[-1] == "boat.param: not checked after line 20"
