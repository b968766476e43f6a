"""What loggers, spreadsheets and exports make of a table, and what is missing in its cells."""

import gzip

import numpy as np
import pytest

from hil.errors import UsageError
from hil.lab.identify.columns import NAMES
from hil.lab.identify.identify import identify
from hil.lab.identify.manoeuvre_file import read
from support.tables import CLOCK, DEGREES, HEADING, ISO, PLAIN, RATE, ROWS, RUDDER, SPEED, TIME, table

PLAINLY = table(",".join(NAMES), PLAIN)
NAMED = table("Time,Rudder,Heading,Rate of Turn,Speed", DEGREES)
UNITS = "s,deg,deg,deg/s,kn"


def with_times(texts, name="time"):
    return table(f"{name},rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s", (texts, *PLAIN[1:]))


LOGGERS = {
    "UTF-16, as a spreadsheet's Unicode text": PLAINLY.encode("utf-16"),
    "one byte a degree sign": table("Time [s],Rudder [°],Heading [°],ROT [°/s],SOG (kn)", DEGREES).encode("latin-1"),
    "packed": gzip.compress(PLAINLY.encode()),
    "lines above": ("Logger X\nDate: 2026-05-01, 10:00\n\n" + PLAINLY).encode(),
    "comments of another kind": ("% MATLAB\n" + PLAINLY).encode(),
    "names in a comment, as of numpy": ("# " + PLAINLY).encode(),
    "units in a line of their own": NAMED.replace("\n", f"\n{UNITS}\n", 1).encode(),
    "a line below": (PLAINLY + "END OF FILE\n").encode(),
    "totals below": (PLAINLY + "Total,,,,12\n").encode(),
    "a last line that was cut": (PLAINLY + "100.0,0.3").encode(),
    "names in humps": table("TimeStamp_s,RudderAngle_deg,HeadingTrue_deg,YawRate_deg_s,BoatSpeed_kn", DEGREES).encode(),
    "names of ROS": table("%time_s,field.rudder_deg,field.hdg_deg,field.rot_deg_s,field.sog_kn", DEGREES).encode(),
    "seconds that rows share": with_times([f"{seconds:.0f}" for seconds in np.floor(TIME)]).encode(),
    "a clock that rows share": with_times([text[:8] for text in CLOCK]).encode(),
    "milliseconds since 1970 by size": with_times([f"{1.7e12 + 1000 * seconds:.0f}" for seconds in TIME]).encode(),
    "nanoseconds since 1970 by size": with_times([f"{1.7e18 + 1e9 * seconds:.0f}" for seconds in TIME]).encode(),
    "slashes": with_times([text.partition("+")[0].replace("-", "/", 2).replace("T", " ") for text in ISO]).encode(),
    "day.month.year": with_times(
        [f"{text[8:10]}.{text[5:7]}.{text[:4]} {text[11:].partition('+')[0]}" for text in ISO]
    ).encode(),
    "month/day/year and half days": with_times(
        [
            f"{text[5:7]}/{text[8:10]}/{text[:4]} {int(text[11:13]) % 12 or 12}{text[13:22]} {'ap'[text[11] > '1']}m"
            for text in ISO
        ]
    ).encode(),
    "day-month-year": with_times(
        [f"{text[8:10]}-{text[5:7]}-{text[:4]} {text[11:].partition('+')[0]}" for text in ISO], "Date Time"
    ).encode(),
    "UTC": with_times([text.replace("+00:00", " UTC") for text in ISO]).encode(),
}


@pytest.mark.parametrize("name", LOGGERS)
def test_what_loggers_and_spreadsheets_make_of_a_table_is_read(tmp_path, name):
    """Each was refused."""
    path = tmp_path / "table.csv"
    path.write_bytes(LOGGERS[name])
    got = read(path)
    np.testing.assert_allclose(got.time_s - got.time_s[0], TIME, atol=1e-5)
    for column, true in zip(
        (got.rudder_rad, got.heading_rad, got.yaw_rate_rad_s, got.speed_m_s), PLAIN[1:], strict=True
    ):
        np.testing.assert_allclose(column, true, atol=1e-5)


def test_a_few_repeated_times_are_an_error(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(with_times([f"{TIME[n - (n % 10 == 5)]:.1f}" for n in range(ROWS)]))
    with pytest.raises(UsageError, match=":7: time_s 2 is not later than 2"):
        read(path)


def with_holes(column, rows, output="nan"):
    lines = PLAINLY.splitlines()
    for row in rows:
        cells = lines[row + 1].split(",")
        cells[NAMES.index(column)] = output
        lines[row + 1] = ",".join(cells)
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("output", ["", "NaN", "N/A", "-", "null"])
def test_rows_without_a_heading_are_ignored(tmp_path, output):
    path = tmp_path / "table.csv"
    path.write_text(with_holes("heading_rad", (3, 50, 51, 199), output))
    got, rows = read(path), np.delete(np.arange(ROWS), (3, 50, 51, 199))
    assert "4 of 200 rows have no heading_rad and are ignored" in got.notes
    np.testing.assert_allclose(got.time_s, TIME[rows])
    np.testing.assert_allclose(got.heading_rad, HEADING[rows], atol=1e-6)


def test_a_compass_that_is_slower_than_the_table_is_read(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(with_holes("heading_rad", [row for row in range(ROWS) if row % 4], ""))
    np.testing.assert_allclose(read(path).heading_rad, HEADING[::4], atol=1e-6)


@pytest.fixture(scope="module")
def slow_sensor(yard):
    """Return rows of 0.05 s, and a boat's rudder, heading and yaw rate in them, with a sensor's noise."""
    time = np.arange(6000) * 0.05
    rudder = yard.steps(time, 0.35, 15.0, 0.2)
    heading, rate = yard.boat(0.1, 5.0, 50.0, 0.02).motion(time, rudder)
    recording = yard.recorded(time, rudder, heading, rate)
    return time, rudder, np.degrees(recording.heading_rad) % 360.0, np.degrees(recording.yaw_rate_rad_s)


def repeated(values, rows):
    return np.repeat(values[::rows], rows)[: values.size]


@pytest.mark.parametrize(
    ("rows", "channels"),
    [(20, "h"), pytest.param(20, "hr", marks=pytest.mark.proof), pytest.param(2, "hr", marks=pytest.mark.proof)],
)
def test_repeated_values_of_a_slow_sensor(tmp_path, slow_sensor, rows, channels):
    """Without this, T was 6.9 +- 0.6 s instead of 5."""
    time, rudder, heading, rate = slow_sensor
    path, columns = tmp_path / "table.csv", [time, np.degrees(rudder), np.round(repeated(heading, rows), 1)]
    name = "time_s,rudder_deg,heading_deg"
    if "r" in channels:
        name, columns = f"{name},yaw_rate_deg_s", [*columns, repeated(rate, rows)]
    path.write_text(table(name, columns))
    got = read(path)
    assert any(f"heading_deg changes in every {rows}th row only" in note for note in got.notes)
    assert np.median(np.diff(got.time_s)) == pytest.approx(0.05 * rows)
    found = identify([got]).judgement.estimates
    for one, true in ((found["K"], 0.1), (found["T"], 5.0)):
        assert one.verdict == "identifiable"
        assert abs(one.value - true) < 3.0 * one.se


def test_a_coarse_compass_is_not_taken_for_a_slow_one(tmp_path):
    """A coarse sensor is constant in slow turns and changes by its resolution."""
    path, time, source = tmp_path / "table.csv", np.arange(4000) * 0.1, np.random.default_rng(1)
    noise = 0.4 * source.standard_normal(time.size)
    for heading in (np.floor(0.5 * time), np.round(30.0 + 20.0 * np.sin(time / 20.0)), np.round(0.5 * time + noise)):
        path.write_text(table("time_s,rudder_deg,heading_deg", (time, 20.0 * np.sin(time / 7.0), heading)))
        got = read(path)
        assert got.time_s.size == time.size
        assert not any("changes in every" in note for note in got.notes)


def test_late_rows_are_sorted_but_not_a_clock_set_back(tmp_path):
    path, lines = tmp_path / "table.csv", PLAINLY.splitlines()
    path.write_text("\n".join([*lines[:50], lines[52], lines[50], lines[51], *lines[53:]]) + "\n")
    got = read(path)
    np.testing.assert_allclose(got.time_s, TIME)
    np.testing.assert_allclose(got.heading_rad, HEADING, atol=1e-6)
    assert "1 row came after a later one; rows sorted by time" in got.notes
    path.write_text(with_times([f"{seconds - 30.0 * (seconds > 60.0):.2f}" for seconds in TIME + 0.01 * (TIME > 60.0)]))
    with pytest.raises(UsageError, match=r":123: time_s 30\.51 is not later than 60"):
        read(path)


@pytest.mark.parametrize(("column", "values"), [("rudder_rad", RUDDER), ("yaw_rate_rad_s", RATE)])
def test_short_gaps_are_interpolated_and_long_ones_ignored(tmp_path, column, values):
    path = tmp_path / "table.csv"
    path.write_text(with_holes(column, (44, 45, *range(100, 115), 199)))
    got, rows = read(path), np.delete(np.arange(ROWS), (*range(100, 115), 199))
    (note,) = got.notes
    assert f"{column} is missing in 18 of 200 rows: 2 interpolated, 16 in long gaps" in note
    np.testing.assert_allclose(got.time_s, TIME[rows])
    bridged = np.interp(rows, np.delete(rows, (44, 45)), np.delete(values[rows], (44, 45)))
    np.testing.assert_allclose(getattr(got, column), bridged, atol=1e-6)


def test_a_rare_speed_is_interpolated(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(with_holes("speed_m_s", [row for row in range(ROWS) if row % 40]))
    np.testing.assert_allclose(read(path).speed_m_s, SPEED)


def test_columns_in_alternate_rows_are_interpolated(tmp_path):
    """As tables of several senders are that were merged by time."""
    path, lines = tmp_path / "table.csv", ["time_s,rudder_rad,heading_rad"]
    for row in range(ROWS):
        lines += [f"{TIME[row]},{RUDDER[row]},", f"{TIME[row] + 0.1},,{HEADING[row]}"]
    path.write_text("\n".join(lines) + "\n")
    got = read(path)
    np.testing.assert_allclose(got.heading_rad, HEADING[:-1], atol=1e-6)
    np.testing.assert_allclose(got.rudder_rad, np.interp(got.time_s, TIME, RUDDER), atol=1e-6)


def test_rare_headings_are_ignored(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(with_holes("heading_rad", range(10, ROWS)))
    got = read(path)
    assert (got.heading_rad, got.time_s.size) == (None, ROWS)


TECPLOT = (
    'TITLE = "Zigzag"\nVARIABLES = "t [s]" "delta [deg]" "psi [deg]" "r [deg/s]" "u [m/s]"\nZONE T="run 12", I=200\n'
)


def test_a_table_of_tecplot_is_read(tmp_path):
    path, rows = tmp_path / "tank.dat", table("t", (TIME, *DEGREES[1:4], PLAIN[4]), "  ").splitlines()[1:]
    path.write_text(TECPLOT + "\n".join(rows) + "\n")
    got = read(path)
    np.testing.assert_allclose(got.rudder_rad, RUDDER, atol=1e-5)
    np.testing.assert_allclose(got.heading_rad, HEADING, atol=1e-5)


def test_quoted_decimal_commas_between_commas_are_read(tmp_path):
    path, lines = tmp_path / "table.csv", PLAINLY.splitlines()
    cells = [",".join(f'"{cell.replace(".", ",")}"' for cell in line.split(",")) for line in lines[1:]]
    path.write_text("\n".join([lines[0], *cells]) + "\n")
    np.testing.assert_allclose(read(path).heading_rad, HEADING, atol=1e-6)


def test_units_behind_a_blank_are_read(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(table("Time,Rudder Angle °,Heading °M,Rate of Turn °/sec", DEGREES[:4]), encoding="utf-8")
    got = read(path)
    np.testing.assert_allclose(got.heading_rad, HEADING, atol=1e-5)
    np.testing.assert_allclose(got.yaw_rate_rad_s, RATE, atol=1e-5)


def test_milliseconds_that_are_named_seconds_are_recognised(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(with_times([f"{1000.0 * seconds:.0f}" for seconds in TIME], "time_s"))
    got = read(path)
    np.testing.assert_allclose(got.time_s, TIME, atol=1e-6)
    assert any("milliseconds assumed" in text for text in got.warnings)


def test_a_repeated_time_removes_one_row(tmp_path):
    path, lines = tmp_path / "table.csv", PLAINLY.splitlines()
    cells = lines[60].split(",")
    lines.insert(61, ",".join([cells[0], "0.1", *cells[2:]]))
    path.write_text("\n".join(lines) + "\n")
    got = read(path)
    np.testing.assert_allclose(got.time_s, TIME)
    assert "1 row has the time of the previous row (first in line 62) and is ignored" in got.notes


def test_a_column_that_names_its_unit_is_believed_with_a_warning(tmp_path):
    """A model boat that turns within its length was refused as being in degrees."""
    path = tmp_path / "table.csv"
    quick = np.cumsum(np.where(np.arange(ROWS) % 20 < 10, 0.5, -0.5))
    slow = np.full(ROWS, 0.1)
    path.write_text(table("time_s,rudder_rad,heading_rad,speed_m_s", (TIME, RUDDER, quick, slow)))
    got = read(path)
    np.testing.assert_allclose(got.heading_rad, quick, atol=1e-5)
    assert any("radians used as named" in text for text in got.warnings)
