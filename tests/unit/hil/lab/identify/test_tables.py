"""Tables and logs of others: read as they mean it, or what is wrong with them is named."""

import json
from datetime import timedelta

import numpy as np
import pytest

from hil.__main__ import main
from hil.errors import UsageError
from hil.lab.identify.columns import NAMES
from hil.lab.identify.manoeuvre_file import read
from support.ardupilot_log import log_bytes
from support.tables import CLOCK, DEGREE, DEGREES, HEADING, ISO, MIDNIGHT, PLAIN, ROWS, RUDDER, TIME, table

NMEA = (*DEGREES[:3], 60 * DEGREES[3], DEGREES[4])
READ = {
    "semicolons": table("time_s;rudder_rad;heading_rad;yaw_rate_rad_s;speed_m_s", PLAIN, ";"),
    "semicolons and decimal commas": table("time_s;rudder_rad;heading_rad;yaw_rate_rad_s;speed_m_s", PLAIN, ";", ","),
    "tabs": table("time_s\trudder_rad\theading_rad\tyaw_rate_rad_s\tspeed_m_s", PLAIN, "\t"),
    "tabs and decimal commas": table("time_s\trudder_rad\theading_rad\tyaw_rate_rad_s\tspeed_m_s", PLAIN, "\t", ","),
    "spaces": table("time_s rudder_rad heading_rad yaw_rate_rad_s speed_m_s", PLAIN, "  "),
    "other names": table("Time [s],Rudder [deg],Heading (°),Rate of Turn [°/s],SOG (kn)", DEGREES),
    "short names": table("t,delta_rad,psi_rad,r_rad_s,u_m_s", PLAIN),
    "names with more words": table("t [s],delta_rudder [rad],psi_hat [rad],r_angvelo [rad/s],u_velo [m/s]", PLAIN),
    "words between name and unit": table(
        "time_s,rudder_actual_deg,Heading measured (°),yaw_rate_raw_deg_s,sog_kn", DEGREES
    ),
    "degrees by name": table("time_s,rudder_deg,heading_deg,yaw_rate_deg_s,speed_kn", DEGREES),
    "degrees a minute": table(
        "time,rudder_deg,hdg_deg,rot_deg_min,stw_kn", (*DEGREES[:3], 60 * DEGREES[3], DEGREES[4])
    ),
    "names without units": table("time,rudder,heading,rot,sog_kn", (*DEGREES[:3], 60 * DEGREES[3], DEGREES[4])),
    "ISO times": table("timestamp,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s", (ISO, *PLAIN[1:])),
    "times of the day": table("time,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s", (CLOCK, *PLAIN[1:])),
    "milliseconds": table("time_ms,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s", (1000 * TIME, *PLAIN[1:])),
    "milliseconds since 1970": table(
        "timestamp_ms,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s", (1000 * TIME + 1.7e12, *PLAIN[1:])
    ),
    "times of the day past midnight": table(
        "utc,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s",
        ([text[11:19] + f".{n % 2 * 5}" for n, text in enumerate(ISO)], *PLAIN[1:]),
    ),
    "another order, more columns, a comment": "# a boat\n"
    + table("depth;speed_m_s;yaw_rate_rad_s;heading_rad;rudder_rad;time_s", (TIME, *PLAIN[::-1]), ";"),
}


@pytest.mark.parametrize("name", READ)
def test_the_tables_of_others_are_read(tmp_path, name):
    path = tmp_path / "table.csv"
    path.write_text(READ[name], encoding="utf-8")
    got = read(path)
    np.testing.assert_allclose(got.time_s - got.time_s[0], TIME, atol=1e-6)
    for column, true in zip(
        (got.rudder_rad, got.heading_rad, got.yaw_rate_rad_s, got.speed_m_s), PLAIN[1:], strict=True
    ):
        np.testing.assert_allclose(column, true, atol=1e-5)
    assert any("has no unit" in note for note in got.notes) == (name == "names without units")


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_a_table_of_a_compass_alone_is_read(tmp_path, unit):
    path, size = tmp_path / "compass.csv", 1.0 if unit == "rad" else DEGREE
    path.write_text(table(f"time_s,rudder_{unit},heading_{unit}", (TIME, RUDDER / size, HEADING / size)))
    got = read(path)
    np.testing.assert_allclose(got.heading_rad, HEADING, atol=1e-6)
    assert got.yaw_rate_rad_s is None
    assert got.speed_m_s is None


def nmea(seconds):
    moment = (MIDNIGHT.replace(second=0) + timedelta(seconds=float(seconds))).time()
    return f"{moment:%H%M%S}.{moment.microsecond // 10000:02d}"


@pytest.mark.parametrize("first_s", [0.0, 15.0, -3500.0])
def test_nmea_times_are_distinguished_from_seconds(tmp_path, first_s):
    """Taken for seconds, each minute's end was a gap of 40 s, and past midnight the rows ran backwards."""
    path, clock = tmp_path / "table.csv", [nmea(first_s + seconds) for seconds in TIME]
    path.write_text(table("utc,rudder_rad,heading_rad", (clock, RUDDER, HEADING)))
    got = read(path)
    np.testing.assert_allclose(got.time_s - got.time_s[0], TIME, atol=1e-6)
    assert any("utc contains times of the day as hhmmss" in note for note in got.notes)
    path.write_text(table("time_s,rudder_rad,heading_rad", (clock, RUDDER, HEADING)))
    with pytest.raises(UsageError, match="time_s jumps by 40 at every full minute"):
        read(path)


@pytest.mark.parametrize("first_s", [0.0, 30.0, 101500.0])
def test_seconds_are_not_taken_for_times_of_the_day(tmp_path, first_s):
    path = tmp_path / "table.csv"
    path.write_text(table("time,rudder_rad,heading_rad", (first_s + TIME, RUDDER, HEADING)))
    np.testing.assert_allclose(read(path).time_s, first_s + TIME)


def test_a_repeated_row_is_used_once(tmp_path):
    path, lines = tmp_path / "table.csv", table(",".join(NAMES), PLAIN).splitlines()
    path.write_text("\n".join([*lines[:50], lines[49], lines[49], *lines[50:]]) + "\n")
    got = read(path)
    np.testing.assert_allclose(got.time_s, TIME)
    np.testing.assert_allclose(got.heading_rad, HEADING, atol=1e-6)
    assert any("2 rows are identical to the previous one" in note for note in got.notes)


def test_line_numbers_after_a_repeated_row(tmp_path):
    path, lines = tmp_path / "table.csv", table(",".join(NAMES), PLAIN).splitlines()
    path.write_text("\n".join([*lines[:50], lines[49], *lines[50:90], lines[60]]) + "\n")
    with pytest.raises(UsageError, match=f"{path.name}:92: time_s 29.5 is not later than 44"):
        read(path)


def test_guessed_units_are_noted(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(table("time,rudder,heading,rot,sog", NMEA))
    taken = "\n".join(read(path).notes)
    for output in ("rudder has no unit: degrees assumed", "rot has no unit: degrees per minute assumed"):
        assert f"column {output}" in taken


def test_a_command_has_no_unit_note(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(table("time_s,rudder,heading_rad", (TIME, 1500 + 400 * RUDDER, HEADING)))
    assert not any("assumed" in note for note in read(path, "any").notes)


def test_the_speed_through_the_water_is_preferred(tmp_path):
    """As a yacht's logger writes both; the table was refused."""
    path, ground = tmp_path / "table.csv", np.full(ROWS, 9.0)
    path.write_text(table("Time,Rudder,Heading,SOG,Speed Through Water", (*DEGREES[:3], ground, PLAIN[4])))
    np.testing.assert_allclose(read(path).speed_m_s, PLAIN[4])


def test_a_table_without_names_is_refused(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(table("0.0,1e-3,-2", (TIME, RUDDER, HEADING)))
    with pytest.raises(UsageError, match=r"table\.csv:1: numbers instead of column names; add a header line"):
        read(path)


def test_a_course_over_ground_is_said_to_be_no_heading(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(table("time_s,rudder_rad,cog_deg", (TIME, RUDDER, TIME)))
    with pytest.raises(
        UsageError, match="; the file has time_s, rudder_rad, cog_deg; cog_deg is the course over ground, not a heading"
    ):
        read(path)


@pytest.mark.parametrize("name", ["rudder_percent", "Rudder [%]", "rudder_pwm", "Rudder (µs)"])
def test_a_rudder_that_is_not_an_angle_by_its_name(tmp_path, name):
    """Values up to 60 in percent must not be read as degrees."""
    path = tmp_path / "table.csv"
    path.write_text(table(f"time_s,{name},heading_deg", (TIME, 100.0 * RUDDER, HEADING / DEGREE)))
    with pytest.raises(UsageError, match="is not an angle; use --rudder-unit any"):
        read(path)
    np.testing.assert_allclose(read(path, "any").rudder_rad, 100.0 * RUDDER, atol=1e-6)


@pytest.mark.parametrize("name", ["rudder_cmd_deg", "Commanded rudder angle (deg)", "rudder_order_deg"])
def test_a_rudder_command_is_used_without_a_measured_angle(tmp_path, name):
    path = tmp_path / "table.csv"
    path.write_text(table(f"time_s,{name},heading_rad", (TIME, RUDDER / DEGREE, HEADING)))
    got = read(path)
    np.testing.assert_allclose(got.rudder_rad, RUDDER, atol=1e-6)
    assert any("is a rudder command, so T includes the servo lag" in note for note in got.notes)
    path.write_text(table(f"time_s,{name},rudder_rad,heading_rad", (TIME, TIME, RUDDER, HEADING)))
    got = read(path)
    np.testing.assert_allclose(got.rudder_rad, RUDDER, atol=1e-6)
    assert not any("asked" in note for note in got.notes)


@pytest.mark.parametrize(
    ("text", "texts"),
    [
        (table("time_s,rudder_rad,depth", (TIME, RUDDER, TIME)), ":1: missing column heading_rad or yaw_rate_rad_s"),
        (
            table("hdg_deg,heading_true_deg,rudder_deg,t", (TIME,) * 4),
            ":1: columns hdg_deg and heading_true_deg",
        ),
        (
            table("time,rudder_rad,heading_rad", (["now"] * ROWS, RUDDER, HEADING)),
            ":2: time 'now' is not a time (and 199 more like it); give seconds, or times as 2026-05-31 23:59:59.5",
        ),
        (table("time_s;rudder_rad;heading_rad", (TIME, RUDDER, HEADING)), ":2: 1 fields for 3 column names"),
        ("heading;rudder\n1;2\n", ":1: missing column time_s"),
        (table("time,rudder_rad,heading_rad", (500 * TIME, RUDDER, HEADING)), ": the rows are 250 apart in time"),
        (table("time_s,rudder,heading", (TIME, RUDDER, 60 * TIME)), ": rudder has values up to 0.3 and no unit"),
        (table("time_s,rudder,heading", (TIME, 300 * RUDDER, 60 * TIME)), ": rudder has values up to 90 and no unit"),
    ],
)
def test_errors_of_a_table(tmp_path, text, texts):
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(UsageError) as refused:
        read(path)
    assert f"{path}{texts}" in str(refused.value)


def ardupilot_log(recording, *, pulses):
    columns = (recording.time_s, recording.rudder_rad, recording.heading_rad, recording.yaw_rate_rad_s)
    return log_bytes(*columns, pulses=pulses)


@pytest.mark.parametrize("pulses", [pytest.param(True, marks=pytest.mark.proof), False])
def test_the_model_from_an_ardupilot_log(yard, tmp_path, capsys, pulses):
    time = np.arange(3000) * 0.1
    rudder = yard.zigzag(time, 0.35, 20.0)
    boat = yard.boat(0.049, 4.0, 17.0)
    path = tmp_path / "00000012.BIN"
    path.write_bytes(ardupilot_log(yard.recorded(time, rudder, *boat.motion(time, rudder)), pulses=pulses))
    assert main(["identify", str(path), "--json", "-"]) == 0
    data = json.loads(capsys.readouterr().out)
    for name, true in (("K", 0.049), ("T", 4.0)):
        assert data[name]["verdict"] == "identifiable"
        assert abs(data[name]["value"] - true) < max(4.0 * data[name]["se"], 0.01 * true)
    assert data["speed_m_s"] == pytest.approx(0.4, rel=1e-3)
    taken = "the output of SERVO2" if pulses else "STER.SteerOut"
    assert any(taken in note for note in data["notes"])
    assert any("45 deg" in note for note in data["notes"])


def test_a_log_of_ardupilot_without_a_rudder_is_refused(yard, tmp_path, capsys):
    time = np.arange(100) * 0.1
    whole = ardupilot_log(yard.recorded(time, 0.1 * time, time, time), pulses=False)
    path = tmp_path / "x.BIN"
    path.write_bytes(whole.replace(b"STER", b"STIR"))
    assert main(["identify", str(path)]) == 2
    assert "no rudder: neither" in capsys.readouterr().err
