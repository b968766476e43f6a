"""Rows and marks of the live page from the status of the autopilot."""

import json

import pytest

from firmware_py.system.status_file import Freshness, StatusReading
from firmware_py.view.feed import STATUS_COLUMNS, Feed
from firmware_py.view.history import COLUMNS, History
from firmware_py.view.model import PANELS

STATUS = {
    "vehicle": "boat", "pid": 7, "written_machine_s": 100.0, "utc_s": 1.8e9, "uptime_s": 50.0, "heading_deg": 12.0,
    "goal_deg": 15.0, "error_deg": 3.0, "faults": [{"fault": "POSITION_LOST"}],
    "events": [{"t_s": 48.0, "severity": 4, "text": "GPS position lost"}], "plan_identities": [1, 0, 0],
    "home": {"lat_deg": 36.0, "lon_deg": 121.0}, "rudder": {"angle_deg": -4.0}, "estimate": {"heading_deg": 11.0},
    "navigation": {"item": 2, "target_lat_deg": 36.1, "target_lon_deg": 121.1, "radius_m": 40.0},
}  # fmt: skip


class Rig:
    def __init__(self):
        self.reading = StatusReading(Freshness.RUNNING, dict(STATUS), 0.1)
        self.plans_read = 0
        self.history = History()
        self.feed = Feed(self.history, lambda: self.reading, self._plans, {"POSITION_LOST": "look at the antenna"})

    def _plans(self):
        self.plans_read += 1
        return {"mission": [[16]]}

    def advance(self, seconds=1.0, **changes):
        content = dict(self.reading.content)
        for name in ("written_machine_s", "utc_s", "uptime_s"):
            content[name] += seconds
        self.reading = StatusReading(Freshness.RUNNING, content | changes, 0.1)

    def poll(self):
        update = self.feed.poll()
        return None if update is None else json.loads(update)

    def values(self):
        return dict(zip(COLUMNS, self.poll()["values"], strict=True))


@pytest.fixture
def rig():
    return Rig()


def test_status_becomes_a_row(rig):
    values = rig.values()
    expected = {"time_s": 0.0, "compass_deg": 12.0, "heading_deg": 11.0, "goal_deg": 15.0, "error_deg": -3.0}
    expected |= {"rudder_deg": -4.0, "faults": 1.0}
    assert {name: values[name] for name in expected} == expected
    assert rig.poll() is None  # the status is unchanged
    assert rig.history.now["begin_utc_s"] == 1.8e9
    rig.advance(2.0)
    assert rig.values()["time_s"] == 2.0
    assert rig.history.now["begin_utc_s"] == 1.8e9


def test_every_column_has_a_source():
    assert set(STATUS_COLUMNS) | {"time_s", "true_heading_deg", "faults"} == set(COLUMNS)


def test_event_is_a_mark_at_its_time_once(rig):
    assert rig.poll()["marks"] == [[-2.0, 4, "GPS position lost"]]
    rig.advance(1.0)
    assert rig.poll()["marks"] == []
    rig.advance(1.0, events=[*STATUS["events"], {"t_s": 51.5, "severity": 6, "text": "GPS position recovered"}])
    assert rig.poll()["marks"] == [[1.5, 6, "GPS position recovered"]]


def test_timed_out_values_are_empty(rig):
    sections = {
        "position": {"lat_deg": 36.0, "sog_m_s": 0.5}, "rudder": {"angle_deg": 4.0}, "depth": {"depth_m": 12.0},
        "wind": {"wind_m_s": 5.0, "gust_m_s": 8.0},
    }  # fmt: skip
    names = ("lat_deg", "ground_m_s", "compass_deg", "heading_deg", "error_deg", "rudder_deg")
    names += ("wind_m_s", "gust_m_s", "depth_m")
    for is_ok, expected in ((True, [36.0, 0.5, 12.0, 11.0, -3.0, 4.0, 5.0, 8.0, 12.0]), (False, [None] * 9)):
        rig.advance(heading_ok=is_ok, **{name: {"ok": is_ok} | values for name, values in sections.items()})
        values = rig.values()
        assert [values[name] for name in names] == expected
    assert rig.history.now["status"]["heading_deg"] == 12.0, "the last value is shown, with its age"


def test_estimated_rudder_angle_is_a_line_of_its_own(rig):
    rig.advance(rudder={"ok": True, "angle_deg": None, "estimated_deg": 3.0})
    values = rig.values()
    assert (values["rudder_deg"], values["rudder_estimated_deg"]) == (None, 3.0)
    rig.advance(rudder={"ok": False, "angle_deg": None, "estimated_deg": 3.0})
    values = rig.values()
    assert (values["rudder_deg"], values["rudder_estimated_deg"]) == (None, None)
    (panel,) = (panel for panel in PANELS if panel.title == "rudder (deg)")
    assert [(line.column, line.label) for line in panel.lines] == [
        ("command_deg", "commanded"),
        ("rudder_estimated_deg", "estimated"),
        ("rudder_deg", "angle"),
    ]


def test_fault_has_its_remedy(rig):
    assert rig.poll()["now"]["status"]["faults"] == [{"fault": "POSITION_LOST", "remedy": "look at the antenna"}]


def test_events_before_a_run_are_at_its_start(rig):
    rig.feed.add_line(b'{"time_s": 0.5}')
    assert rig.poll()["marks"] == [[0.0, 4, "GPS position lost"]]


def test_plans_are_read_after_a_change(rig):
    now = rig.poll()["now"]
    assert now["plans"] == {"mission": [[16]], "home": [36.0, 121.0]}
    assert now["target"] == [36.1, 121.1, 40.0]
    rig.advance()
    assert "plans" not in rig.poll()["now"]
    rig.advance(plan_identities=[2, 0, 0])
    assert "plans" in rig.poll()["now"]
    assert rig.plans_read == 2
    rig.advance(home={})
    assert rig.poll()["now"]["plans"] == {"mission": [[16]]}
    for missing in ("target_lat_deg", "target_lon_deg"):
        rig.advance(navigation=STATUS["navigation"] | {missing: None})
        assert rig.poll()["now"]["target"] is None


def test_stale_status_adds_no_row(rig):
    rig.poll()
    content = rig.reading.content | {"events": [{"t_s": 49.0, "severity": 4, "text": "late"}], "plan_identities": [9]}
    rig.reading = StatusReading(Freshness.STALE, content, 9.0, "process 7 has ended")
    update = rig.poll()
    assert (update["now"]["freshness"], update["now"]["reason"], update["rows"]) == ("stale", "process 7 has ended", [])
    assert (update["marks"], rig.plans_read) == ([], 1)
    rig.reading = StatusReading(Freshness.ABSENT, reason="it is not running")
    assert rig.poll()["now"]["freshness"] == "absent"


def test_stale_status_at_the_start_has_the_time_of_its_computer(rig):
    rig.reading = StatusReading(Freshness.STALE, rig.reading.content, 9.0, "process 7 has ended")
    assert rig.poll()["now"]["begin_utc_s"] == 1.8e9 - 100.0


def test_restarted_computer_begins_another_voyage(rig):
    rig.advance(50.0)
    rig.poll()
    rig.advance(-140.0)
    assert rig.values()["time_s"] == 0.0
    assert len(json.loads(rig.history.all_data())["rows"]) == 1


def test_harness_lines_add_true_values(rig):
    rig.feed.add_line(b'{"title": "tank"}')
    assert rig.poll() is None  # the simulation has not started
    rig.feed.add_line(b'{"time_s": 50.5, "true_heading_deg": 371.2}\n')
    values = rig.values()
    assert (values["time_s"], values["true_heading_deg"], values["compass_deg"]) == (50.5, 371.2, 12.0)
    assert rig.history.now["title"] == "tank"
    assert "begin_utc_s" not in rig.history.now


def test_numbers_and_texts_up_to_their_limits_are_accepted(rig):
    rig.feed.add_line(b'{"time_s": 1.0, "true_heading_deg": -1e15, "title": "' + b"x" * 300 + b'"}')
    rig.advance(goal_deg=1e15, heading_deg=-1e15, error_deg=1.1e15)
    values = rig.values()
    names = ("true_heading_deg", "goal_deg", "compass_deg", "error_deg")
    assert [values[name] for name in names] == [-1e15, 1e15, -1e15, None]
    rig.feed.add_line(b'{"time_s": 2.0, "true_heading_deg": 1.1e15, "title": "' + b"y" * 301 + b'"}')
    assert rig.values()["true_heading_deg"] == -1e15
    assert rig.history.now["title"] == "x" * 300
    rig.feed.add_line(b'{"time_s": 3.0' + b" " * 16_369 + b"}")  # 16,384 bytes
    rig.feed.add_line(b'{"time_s": 4.0' + b" " * 16_370 + b"}")
    assert rig.values()["time_s"] == 3.0


def test_last_500_events_are_known(rig):
    for count, repeated in ((500, 0), (501, 501)):
        events = [{"t_s": number + 0.04, "severity": 4, "text": "x" * 301} for number in range(count)]
        rig.advance(events=events, pid=count)
        assert len(marks := rig.poll()["marks"]) == count
        assert marks[0] == [-51.0, 4, "x" * 300]
        rig.advance()
        assert len(rig.poll()["marks"]) == repeated


@pytest.mark.parametrize("line", [b"", b"\xff", b"[1]", b"{", b"[" * 9000, b'{"time_s": ' + b"1" * 20_000 + b"}"])
def test_invalid_harness_line_is_ignored(rig, line):
    rig.feed.add_line(line)
    assert rig.values()["time_s"] == 0.0


@pytest.mark.parametrize(
    "changes", [{"events": 3}, {"faults": None}, {"rudder": [1]}, {"utc_s": "x"}, {"home": {"x": 1}}]
)
def test_status_of_another_version_is_reported(rig, changes):
    rig.advance(**changes)
    assert rig.poll()["now"]["freshness"] in ("stale", "running")


def test_columns_have_the_values_of_the_status_and_the_error_is_heading_minus_goal(rig):
    sections = {}
    for section, name in STATUS_COLUMNS.values():
        (sections.setdefault(section, {}) if section else sections)[name] = 2.0
    rig.advance(heading_ok=True, **{k: v for k, v in sections.items() if k != "navigation"},
                navigation={**sections["navigation"], "activity": "LINE"})  # fmt: skip
    row = rig.poll()["rows"][-1]
    values = dict(zip(COLUMNS, row, strict=True))
    assert {name: values[name] for name in STATUS_COLUMNS if name != "error_deg"} == dict.fromkeys(
        (name for name in STATUS_COLUMNS if name != "error_deg"), 2.0
    )
    assert values["error_deg"] == -2.0
    rig.advance(navigation={**sections["navigation"], "activity": "HEADING"})
    assert rig.values()["cross_track_m"] is None  # no line
