"""Formats of manoeuvre tables: names, units, times, separators and encodings; and the errors for invalid tables."""

import gzip
from datetime import timedelta

import numpy as np
import pytest

from hil.errors import UsageError
from hil.lab.identify.columns import NAMES
from support.tables import CLOCK, DEGREE, DEGREES, HEADING, ISO, MIDNIGHT, PLAIN, RATE, ROWS, RUDDER, TIME, table

HEADER = ",".join(NAMES)
TABLE = table(HEADER, PLAIN)
WITH_NAMES = table("Time,Rudder,Heading,Rate of Turn,Speed", DEGREES)
PER_MINUTE = (*DEGREES[:3], 60 * DEGREES[3], DEGREES[4])
ISO_LOCAL = [text.partition("+")[0] for text in ISO]


def with_times(texts, name="time"):
    return table(f"{name},rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s", (texts, *PLAIN[1:]))


def separated(separator, decimal="."):
    return table(HEADER.replace(",", separator), PLAIN, separator, decimal)


ACCEPTED = {
    "semicolons": separated(";"),
    "semicolons-decimal-commas": separated(";", ","),
    "tabs": separated("\t"),
    "tabs-decimal-commas": separated("\t", ","),
    "spaces": table(HEADER.replace(",", " "), PLAIN, "  "),
    "quoted-decimal-commas": "\n".join(
        [HEADER, *(",".join(f'"{c.replace(".", ",")}"' for c in line.split(",")) for line in TABLE.splitlines()[1:])]
    ),
    "units-in-brackets": table("Time [s],Rudder [deg],Heading (°),Rate of Turn [°/s],SOG (kn)", DEGREES),
    "units-after-blank": table("Time,Rudder Angle °,Heading °M,Rate of Turn °/sec,SOG kn", DEGREES),
    "short-names": table("t,delta_rad,psi_rad,r_rad_s,u_m_s", PLAIN),
    "extra-words-before": table("t [s],delta_rudder [rad],psi_hat [rad],r_angvelo [rad/s],u_velo [m/s]", PLAIN),
    "extra-words-after": table("time_s,rudder_actual_deg,Heading measured (°),yaw_rate_raw_deg_s,sog_kn", DEGREES),
    "camel-case": table("TimeStamp_s,RudderAngle_deg,HeadingTrue_deg,YawRate_deg_s,BoatSpeed_kn", DEGREES),
    "ROS-names": table("%time_s,field.rudder_deg,field.hdg_deg,field.rot_deg_s,field.sog_kn", DEGREES),
    "degrees-by-name": table("time_s,rudder_deg,heading_deg,yaw_rate_deg_s,speed_kn", DEGREES),
    "degrees-per-minute": table("time,rudder_deg,hdg_deg,rot_deg_min,stw_kn", PER_MINUTE),
    "no-units": table("time,rudder,heading,rot,sog_kn", PER_MINUTE),
    "ISO-times": with_times(ISO, "timestamp"),
    "ISO-times-UTC": with_times([text.replace("+00:00", " UTC") for text in ISO]),
    "times-of-day": with_times(CLOCK),
    "times-of-day-past-midnight": with_times([text[11:19] + f".{n % 2 * 5}" for n, text in enumerate(ISO)], "utc"),
    "milliseconds": with_times(1000 * TIME, "time_ms"),
    "milliseconds-since-1970": with_times(1000 * TIME + 1.7e12, "timestamp_ms"),
    "milliseconds-since-1970-by-size": with_times([f"{1.7e12 + 1000 * seconds:.0f}" for seconds in TIME]),
    "nanoseconds-since-1970-by-size": with_times([f"{1.7e18 + 1e9 * seconds:.0f}" for seconds in TIME]),
    "rows-share-seconds": with_times([f"{seconds:.0f}" for seconds in np.floor(TIME)]),
    "rows-share-time-of-day": with_times([text[:8] for text in CLOCK]),
    "year/month/day": with_times([text.replace("-", "/", 2).replace("T", " ") for text in ISO_LOCAL]),
    "day.month.year": with_times([f"{text[8:10]}.{text[5:7]}.{text[:4]} {text[11:]}" for text in ISO_LOCAL]),
    "day-month-year": with_times([f"{t[8:10]}-{t[5:7]}-{t[:4]} {t[11:]}" for t in ISO_LOCAL], "Date Time"),
    "month/day/year-am-pm": with_times(
        [f"{t[5:7]}/{t[8:10]}/{t[:4]} {int(t[11:13]) % 12 or 12}{t[13:22]} {'ap'[t[11] > '1']}m" for t in ISO]
    ),
    "other-order-more-columns-comment": "# a boat\n"
    + table("depth;speed_m_s;yaw_rate_rad_s;heading_rad;rudder_rad;time_s", (TIME, *PLAIN[::-1]), ";"),
    "UTF-16": TABLE.encode("utf-16"),
    "latin-1": table("Time [s],Rudder [°],Heading [°],ROT [°/s],SOG (kn)", DEGREES).encode("latin-1"),
    "gzip": gzip.compress(TABLE.encode()),
    "lines-above": "Logger X\nDate: 2026-05-01, 10:00\n\n" + TABLE,
    "MATLAB-comment": "% MATLAB\n" + TABLE,
    "names-in-a-comment": "# " + TABLE,
    "line-of-units": WITH_NAMES.replace("\n", "\ns,deg,deg,deg/s,kn\n", 1),
    "line-below": TABLE + "END OF FILE\n",
    "totals-below": TABLE + "Total,,,,12\n",
    "truncated-last-line": TABLE + "100.0,0.3",
    "Tecplot": 'TITLE = "Zigzag"\nVARIABLES = "t [s]" "delta [deg]" "psi [deg]" "r [deg/s]" "u [m/s]"\n'
    'ZONE T="run 12", I=200\n' + table("t", (TIME, *DEGREES[1:4], PLAIN[4]), "  ").partition("\n")[2],
}


@pytest.mark.parametrize("name", ACCEPTED)
def test_table_format_is_read(read_table, name):
    recording = read_table(ACCEPTED[name])
    np.testing.assert_allclose(recording.time_s - recording.time_s[0], TIME, atol=1e-5 if "size" in name else 1e-6)
    columns = (recording.rudder_rad, recording.heading_rad, recording.yaw_rate_rad_s, recording.speed_m_s)
    for column, true in zip(columns, PLAIN[1:], strict=True):
        np.testing.assert_allclose(column, true, atol=1e-5)
    if name == "no-units":
        for text in ("rudder has no unit: degrees assumed", "rot has no unit: degrees per minute assumed"):
            assert f"column {text}" in recording.notes
    elif name not in ("line-of-units", "units-after-blank"):
        assert not any("has no unit" in note for note in recording.notes)


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_table_with_only_a_compass_is_read(read_table, unit):
    size = 1.0 if unit == "rad" else DEGREE
    recording = read_table(table(f"time_s,rudder_{unit},heading_{unit}", (TIME, RUDDER / size, HEADING / size)))
    np.testing.assert_allclose(recording.heading_rad, HEADING, atol=1e-6)
    assert (recording.yaw_rate_rad_s, recording.speed_m_s) == (None, None)


def nmea_time(seconds):
    moment = (MIDNIGHT.replace(second=0) + timedelta(seconds=float(seconds))).time()
    return f"{moment:%H%M%S}.{moment.microsecond // 10000:02d}"


@pytest.mark.parametrize("first_s", [0.0, 15.0, -3500.0])
def test_times_as_hhmmss_are_recognised_unless_named_seconds(read_table, first_s):
    times = [nmea_time(first_s + seconds) for seconds in TIME]
    recording = read_table(table("utc,rudder_rad,heading_rad", (times, RUDDER, HEADING)))
    np.testing.assert_allclose(recording.time_s - recording.time_s[0], TIME, atol=1e-6)
    assert any("utc contains times of the day as hhmmss" in note for note in recording.notes)
    with pytest.raises(UsageError, match="time_s jumps by 40 at every full minute"):
        read_table(table("time_s,rudder_rad,heading_rad", (times, RUDDER, HEADING)))


@pytest.mark.parametrize("first_s", [0.0, 30.0, 101500.0])
def test_seconds_are_not_read_as_hhmmss(read_table, first_s):
    recording = read_table(table("time,rudder_rad,heading_rad", (first_s + TIME, RUDDER, HEADING)))
    np.testing.assert_allclose(recording.time_s, first_s + TIME)


def test_milliseconds_named_seconds_are_recognised(read_table):
    recording = read_table(with_times([f"{1000.0 * seconds:.0f}" for seconds in TIME], "time_s"))
    np.testing.assert_allclose(recording.time_s, TIME, atol=1e-6)
    assert any("milliseconds assumed" in text for text in recording.warnings)


def test_speed_through_the_water_is_preferred_to_speed_over_ground(read_table):
    header = "Time,Rudder,Heading,SOG,Speed Through Water"
    recording = read_table(table(header, (*DEGREES[:3], np.full(ROWS, 9.0), PLAIN[4])))
    np.testing.assert_allclose(recording.speed_m_s, PLAIN[4])


@pytest.mark.parametrize("name", ["rudder_percent", "Rudder [%]", "rudder_pwm", "Rudder (µs)"])
def test_rudder_that_is_not_an_angle_by_its_name_needs_an_option(read_table, name):
    text = table(f"time_s,{name},heading_deg", (TIME, 100.0 * RUDDER, HEADING / DEGREE))
    with pytest.raises(UsageError, match="is not an angle; use --rudder-unit any"):
        read_table(text)
    np.testing.assert_allclose(read_table(text, "any").rudder_rad, 100.0 * RUDDER, atol=1e-6)


def test_rudder_of_any_unit_has_no_unit_note(read_table):
    text = table("time_s,rudder,heading_rad", (TIME, 1500 + 400 * RUDDER, HEADING))
    assert not any("assumed" in note for note in read_table(text, "any").notes)


@pytest.mark.parametrize("name", ["rudder_cmd_deg", "Commanded rudder angle (deg)", "rudder_order_deg"])
def test_rudder_command_is_used_only_without_a_measured_angle(read_table, name):
    recording = read_table(table(f"time_s,{name},heading_rad", (TIME, RUDDER / DEGREE, HEADING)))
    np.testing.assert_allclose(recording.rudder_rad, RUDDER, atol=1e-6)
    assert any("is a rudder command, so T includes the servo lag" in note for note in recording.notes)
    recording = read_table(table(f"time_s,{name},rudder_rad,heading_rad", (TIME, TIME, RUDDER, HEADING)))
    np.testing.assert_allclose(recording.rudder_rad, RUDDER, atol=1e-6)
    assert not any("command" in note for note in recording.notes)


def test_heading_in_named_radians_is_accepted_for_a_fast_turn_with_a_warning(read_table):
    heading = np.cumsum(np.where(np.arange(ROWS) % 20 < 10, 0.5, -0.5))
    columns = (TIME, RUDDER, heading, np.full(ROWS, 0.1))
    recording = read_table(table("time_s,rudder_rad,heading_rad,speed_m_s", columns))
    np.testing.assert_allclose(recording.heading_rad, heading, atol=1e-5)
    assert any("radians used as named" in text for text in recording.warnings)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (table("time_s,rudder_rad,depth", (TIME, RUDDER, TIME)), ":1: missing column heading_rad or yaw_rate_rad_s"),
        (
            table("time_s,rudder_rad,cog_deg", (TIME, RUDDER, TIME)),
            "; the file has time_s, rudder_rad, cog_deg; cog_deg is the course over ground, not a heading",
        ),
        (table("hdg_deg,heading_true_deg,rudder_deg,t", (TIME,) * 4), ":1: columns hdg_deg and heading_true_deg"),
        (table("0.0,1e-3,-2", (TIME, RUDDER, HEADING)), ":1: numbers instead of column names; add a header line"),
        (
            table("time,rudder_rad,heading_rad", (["now"] * ROWS, RUDDER, HEADING)),
            ":2: time 'now' is not a time (and 199 more like it); give seconds, or times as 2026-05-31 23:59:59.5",
        ),
        (table("time_s;rudder_rad;heading_rad", (TIME, RUDDER, HEADING)), ":2: 1 fields for 3 column names"),
        ("heading;rudder\n1;2\n", ":1: missing column time_s"),
        (table("time,rudder_rad,heading_rad", (500 * TIME, RUDDER, HEADING)), ": the rows are 250 apart in time"),
        (table("time_s,rudder,heading", (TIME, RUDDER, 60 * TIME)), ": rudder has values up to 0.3 and no unit"),
        (table("time_s,rudder,heading", (TIME, 300 * RUDDER, 60 * TIME)), ": rudder has values up to 90 and no unit"),
        (with_times([f"{TIME[n - (n % 10 == 5)]:.1f}" for n in range(ROWS)]), ":7: time_s 2 is not later than 2"),
    ],
)
def test_invalid_table_is_refused_with_its_line(read_table, text, error):
    with pytest.raises(UsageError) as refusal:
        read_table(text)
    assert f"table.csv{error}" in str(refusal.value) or (error.startswith(";") and error in str(refusal.value))


def with_rows(*rows):
    """Return the table with these rows, each a row number or a line."""
    lines = TABLE.splitlines()
    return "\n".join([lines[0], *(row if isinstance(row, str) else lines[row + 1] for row in rows)]) + "\n"


CELLS_59 = TABLE.splitlines()[60].split(",")


@pytest.mark.parametrize(
    ("rows", "note"),
    [
        pytest.param((*range(49), 48, 48, *range(49, 200)), "2 rows are identical to the previous one", id="repeated"),
        pytest.param(
            (*range(60), ",".join([CELLS_59[0], "0.1", *CELLS_59[2:]]), *range(60, 200)),
            "1 row has the time of the previous row (first in line 62) and is ignored",
            id="same-time",
        ),
        pytest.param((*range(49), 51, 49, 50, *range(52, 200)), "1 row came after a later one; rows sorted", id="late"),
    ],
)
def test_repeated_and_late_rows_are_mended(read_table, rows, note):
    recording = read_table(with_rows(*rows))
    np.testing.assert_allclose(recording.time_s, TIME)
    np.testing.assert_allclose(recording.heading_rad, HEADING, atol=1e-6)
    assert any(note in text for text in recording.notes)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (with_rows(*range(49), 48, *range(49, 89), 59), "table.csv:92: time_s 29.5 is not later than 44"),
        (
            with_times([f"{s - 30.0 * (s > 60.0):.2f}" for s in TIME + 0.01 * (TIME > 60.0)]),
            r":123: time_s 30\.51 is not later than 60",
        ),
    ],
    ids=["last-row-early", "clock-set-back"],
)
def test_decreasing_times_are_refused_with_the_line_of_the_file(read_table, text, error):
    with pytest.raises(UsageError, match=error):
        read_table(text)


def with_missing(column, rows, text=""):
    lines = TABLE.splitlines()
    for row in rows:
        cells = lines[row + 1].split(",")
        cells[NAMES.index(column)] = text
        lines[row + 1] = ",".join(cells)
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("text", ["", "NaN", "N/A", "-", "null"])
def test_rows_without_a_heading_are_ignored(read_table, text):
    recording = read_table(with_missing("heading_rad", (3, 50, 51, 199), text))
    rows = np.delete(np.arange(ROWS), (3, 50, 51, 199))
    assert "4 of 200 rows have no heading_rad and are ignored" in recording.notes
    np.testing.assert_allclose(recording.time_s, TIME[rows])
    np.testing.assert_allclose(recording.heading_rad, HEADING[rows], atol=1e-6)


def test_headings_in_every_fourth_row_are_kept_and_rare_ones_ignored(read_table):
    recording = read_table(with_missing("heading_rad", [row for row in range(ROWS) if row % 4]))
    np.testing.assert_allclose(recording.heading_rad, HEADING[::4], atol=1e-6)
    recording = read_table(with_missing("heading_rad", range(10, ROWS)))
    assert (recording.heading_rad, recording.time_s.size) == (None, ROWS)


@pytest.mark.parametrize(("column", "values"), [("rudder_rad", RUDDER), ("yaw_rate_rad_s", RATE)])
def test_short_gaps_are_interpolated_and_long_ones_ignored(read_table, column, values):
    recording = read_table(with_missing(column, (44, 45, *range(100, 115), 199)))
    rows = np.delete(np.arange(ROWS), (*range(100, 115), 199))
    (note,) = recording.notes
    assert f"{column} is missing in 18 of 200 rows: 2 interpolated, 16 in long gaps" in note
    np.testing.assert_allclose(recording.time_s, TIME[rows])
    interpolated = np.interp(rows, np.delete(rows, (44, 45)), np.delete(values[rows], (44, 45)))
    np.testing.assert_allclose(getattr(recording, column), interpolated, atol=1e-6)


def test_speed_in_every_fortieth_row_is_interpolated(read_table):
    recording = read_table(with_missing("speed_m_s", [row for row in range(ROWS) if row % 40]))
    np.testing.assert_allclose(recording.speed_m_s, PLAIN[4])


def test_columns_in_alternate_rows_are_interpolated(read_table):
    lines = ["time_s,rudder_rad,heading_rad"]
    for row in range(ROWS):
        lines += [f"{TIME[row]},{RUDDER[row]},", f"{TIME[row] + 0.1},,{HEADING[row]}"]
    recording = read_table("\n".join(lines) + "\n")
    np.testing.assert_allclose(recording.heading_rad, HEADING[:-1], atol=1e-6)
    np.testing.assert_allclose(recording.rudder_rad, np.interp(recording.time_s, TIME, RUDDER), atol=1e-6)


def test_coarse_compass_is_not_a_slow_sensor(read_table):
    time, source = np.arange(4000) * 0.1, np.random.default_rng(1)
    noise = 0.4 * source.standard_normal(time.size)
    for heading in (np.floor(0.5 * time), np.round(30.0 + 20.0 * np.sin(time / 20.0)), np.round(0.5 * time + noise)):
        recording = read_table(table("time_s,rudder_deg,heading_deg", (time, 20.0 * np.sin(time / 7.0), heading)))
        assert recording.time_s.size == time.size
        assert not any("changes in every" in note for note in recording.notes)
