"""What a page under way has to show stays small, and whole."""

import json
import math

from firmware_py.view.history import COLUMNS, MAX_MARKS, MAX_ROWS, History


def whole(history):
    return json.loads(history.whole())


def test_a_reader_is_told_what_has_come_and_can_be_told_all():
    history = History()
    told = json.loads(
        history.add({"time_s": 1.0, "heading_deg": 10.0004}, [(0.5, 4, "GPS position lost")], {"title": "boat"})
    )
    assert told["rows"] == [told["values"]]
    assert dict(zip(COLUMNS, told["values"], strict=True))["heading_deg"] == 10.0
    assert told["marks"] == [[0.5, 4, "GPS position lost"]]
    assert whole(history)["rows"] == told["rows"]
    assert whole(history)["now"] == {"title": "boat"}


def test_however_long_it_takes_the_rows_are_few_and_reach_from_begin_to_end():
    history = History()
    for number in range(20_000):
        history.add({"time_s": float(number)}, [(float(number), 6, "x")], {})
    found = whole(history)
    times = [row[0] for row in found["rows"]]
    assert MAX_ROWS / 2 <= len(times) <= MAX_ROWS
    assert times[0] == 0.0
    assert times[-1] > 19_980.0
    assert times == sorted(times)
    assert len(found["marks"]) == MAX_MARKS
    assert history.epoch > 0, "readers that have the rows that were left out are told anew"


def test_what_is_no_number_is_null():
    history = History()
    told = json.loads(
        history.add({"time_s": 1.0, "heading_deg": math.nan, "goal_deg": "x", "rudder_deg": None}, [], {})
    )
    assert set(told["values"][1:]) == {None}


def test_a_row_without_a_time_is_no_row():
    history = History()
    assert json.loads(history.add({}, [], {"freshness": "absent"}))["rows"] == []


def test_another_voyage_begins_anew():
    history = History()
    history.add({"time_s": 1.0}, [(0.5, 4, "x")], {})
    history.restart()
    assert whole(history)["rows"] == whole(history)["marks"] == []
    assert history.epoch == 1
