"""The history of the live page has a limited size."""

import json
import math

from firmware_py.view.history import COLUMNS, History

MAX_MARKS = 300
MAX_ROWS = 2400


def read_all(history):
    return json.loads(history.all_data())


def test_history_returns_updates_and_all_data():
    history = History()
    update = json.loads(
        history.add({"time_s": 1.0, "heading_deg": 10.0004}, [(0.5, 4, "GPS position lost")], {"title": "boat"})
    )
    assert update["rows"] == [update["values"]]
    assert dict(zip(COLUMNS, update["values"], strict=True))["heading_deg"] == 10.0
    assert update["marks"] == [[0.5, 4, "GPS position lost"]]
    assert read_all(history)["rows"] == update["rows"]
    assert read_all(history)["now"] == {"title": "boat"}
    history.add({"time_s": 1.1}, [], {})
    assert [row[0] for row in read_all(history)["rows"]] == [1.0, 1.1]


def test_number_of_rows_is_limited_over_the_whole_voyage():
    history = History()
    for number in range(20_000):
        history.add({"time_s": float(number)}, [(float(number), 6, "x")], {})
        if number in (2399, 2400):
            assert (len(read_all(history)["rows"]), history.epoch) == ((2400, 0) if number == 2399 else (1201, 1))
    data = read_all(history)
    times = [row[0] for row in data["rows"]]
    assert MAX_ROWS / 2 <= len(times) <= MAX_ROWS
    assert times[0] == 0.0
    assert times[-1] > 19_980.0
    assert times == sorted(times)
    assert len(data["marks"]) == MAX_MARKS
    assert history.epoch > 0  # readers must reload all rows


def test_numbers_are_rounded_and_invalid_ones_are_null():
    history = History()
    update = json.loads(
        history.add({"time_s": 1.0, "heading_deg": math.nan, "goal_deg": "x", "rudder_deg": None}, [], {})
    )
    assert set(update["values"][1:]) == {None}
    row = {"lat_deg": 36.123456789, "lon_deg": -1e15, "heading_deg": 1.23456, "goal_deg": 1e15, "rudder_deg": 1.1e15}
    values = dict(zip(COLUMNS, json.loads(history.add(row, [], {}))["values"], strict=True))
    expected = {"lat_deg": 36.1234568, "lon_deg": -1e15, "heading_deg": 1.235, "goal_deg": 1e15, "rudder_deg": None}
    assert {name: values[name] for name in row} == expected


def test_row_without_time_is_ignored():
    history = History()
    assert json.loads(history.add({}, [], {"freshness": "absent"}))["rows"] == []


def test_restart_clears_rows_and_marks():
    history = History()
    for number in range(2401):
        history.add({"time_s": 100.0 + number}, [(0.5, 4, "x")], {})
    history.restart()
    assert read_all(history)["rows"] == read_all(history)["marks"] == []
    assert history.epoch == 2
    for time_s in (1.0, 1.5, 1.4):  # every row again, but none that goes back in time
        history.add({"time_s": time_s}, [], {})
    assert [row[0] for row in read_all(history)["rows"]] == [1.0, 1.5]


def test_rows_follow_at_the_interval_of_the_earlier_ones():
    """After 2401 rows of a second each, every other row is kept, and a further one after 2400 / 1201 s."""
    history = History()
    for number in range(2401):
        history.add({"time_s": 9000.0 + number}, [], {})
    assert [row[0] for row in read_all(history)["rows"]][-2:] == [11398.0, 11400.0]
    added = [
        json.loads(history.add({"time_s": time_s}, [], {}))["rows"] for time_s in (11401.0, 11401.9, 11402.0, 11403.9)
    ]
    assert [len(rows) for rows in added] == [0, 0, 1, 0]
