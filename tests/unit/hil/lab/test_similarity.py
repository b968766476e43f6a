"""`rambler-hil similarity`: command line and numbers."""

import json
import math

import pytest

from firmware_py.model.kt import OCEAN_RAMBLER
from hil.__main__ import main
from hil.lab.similarity import dimensionless, table
from hil.ship.regressions import FLOAT


def test_table_has_a_row_for_each_speed_and_warnings(capsys):
    assert main(["similarity", "--speeds", "0.4,0.8"]) == 0
    lines = capsys.readouterr().out.splitlines()
    tank, fast = lines[1].split(), lines[2].split()
    assert tank[:9] == ["0.4", "0.049", "4", "17", "0.4894", "0.9752", "1.4541", "1.6900", "15.76"]
    assert fast[:4] == ["0.8", "0.098", "2", "4.25"]
    assert sum(line.startswith("warning: ") for line in lines) == 2


def test_json_contains_the_same_rows(capsys):
    assert main(["similarity", "--speeds", "0.8", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    (row,) = result["rows"]
    assert (row["turning_ability_1_s"], row["turning_lag_s"], row["norrbin_s2"]) == pytest.approx((0.098, 2.0, 4.25))
    assert result["dimensionless"]["turning_ability"] == pytest.approx(0.049 * 3.05 / 0.4)
    assert len(result["warnings"]) == 2


def test_dimensionless_numbers_are_constant():
    at_0_4_m_s = dimensionless(OCEAN_RAMBLER, 3.05)
    for speed_m_s in (0.1, 0.9, 2.0):
        scaled = dimensionless(OCEAN_RAMBLER.at_speed(speed_m_s), 3.05)
        assert (scaled.turning_ability, scaled.turning_lag, scaled.norrbin) == pytest.approx(
            (at_0_4_m_s.turning_ability, at_0_4_m_s.turning_lag, at_0_4_m_s.norrbin)
        )


def test_similar_turns_have_equal_radii_and_rates_proportional_to_speed():
    slow, fast = table(OCEAN_RAMBLER, FLOAT, (0.2, 1.0))
    assert slow.radius_m == pytest.approx(fast.radius_m)
    assert slow.radius_with_sway_m == pytest.approx(fast.radius_with_sway_m)
    assert slow.radius_with_sway_m > slow.radius_m
    assert [rate * 5.0 for rate in slow.steady_rates_deg_s] == pytest.approx(list(fast.steady_rates_deg_s))


def vehicle(tmp_path, hull, parameters=""):
    path = tmp_path / "boat.toml"
    path.write_text(
        '[vehicle]\nname = "boat"\n[compass]\ndriver = "nmea"\nport = "/dev/x"\nbaud = 38400\n'
        '[position]\ndriver = "nmea"\nport = "/dev/y"\nbaud = 9600\n'
        '[rudder]\ndriver = "dynamixel"\nport = "/dev/z"\nbaud = 57600\nid = 1\n'
        f"[hull]\n{hull}\n[parameters]\n{parameters}\n"
    )
    return str(path)


def test_vehicle_file_determines_model_and_hull(tmp_path, capsys):
    hull = "length_m = 150\nbeam_m = 25\ndraft_m = 10\nmass_kg = 900000\nblock_coefficient = 0.6"
    path = vehicle(tmp_path, hull, "MDL_K = 0.1\nMDL_SPEED = 0.8")
    assert main(["similarity", "--speeds", "0.4", "--vehicle", path, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["rows"][0]["turning_ability_1_s"] == pytest.approx(0.05)
    assert result["hull"]["length_m"] == 150.0
    assert result["warnings"] == []


@pytest.mark.parametrize(
    ("hull", "remedy"),
    [
        ("length_m = 3.05", "[hull] beam_m: give a number"),
        (
            'length_m = "long"\nbeam_m = 1\ndraft_m = 1\nmass_kg = 1',
            "[hull] length_m: expected a number from 0.1 to 1000",
        ),
        ("length_m = 3\nbeam_m = 1\ndraft_m = 0.1\nmass_kg = 900", "check the mass and the draft"),
        (
            "length_m = 3\nbeam_m = 1\ndraft_m = 0.1\nmass_kg = 90\nblock_coefficient = true",
            "[hull] block_coefficient: expected a number from 0.05 to 1",
        ),
        (
            "length_m = 0\nbeam_m = 1\ndraft_m = 0.1\nmass_kg = 90",
            "[hull] length_m: 0 is out of range; allowed: 0.1 to 1000",
        ),
    ],
)
def test_invalid_hull_is_refused_in_one_line(tmp_path, capsys, hull, remedy):
    path = vehicle(tmp_path, hull)
    assert main(["similarity", "--vehicle", path]) == 2
    error = capsys.readouterr().err
    assert remedy in error
    assert path in error
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize("text", ["", "0", "-1", "nan", "inf", "1e9", "0.4,,0.8", "fast", ",".join(["1"] * 1001)])
def test_invalid_speeds_are_refused(capsys, text):
    assert main(["similarity", f"--speeds={text}"]) == 2
    assert "rambler-hil: --speeds: " in capsys.readouterr().err


def test_rudder_offset_of_the_model_does_not_change_the_radius():
    (row,) = table(OCEAN_RAMBLER, FLOAT, (0.4,))
    assert row.radius_m == pytest.approx(0.4 / math.radians(row.steady_rates_deg_s[2]))
