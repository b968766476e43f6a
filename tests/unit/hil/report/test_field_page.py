"""The page of complete and damaged logs of a boat."""

import math
import random
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from msgspec.structs import replace

from firmware_py import __main__ as rambler
from firmware_py.log.dataflash import header
from firmware_py.log.thin import HEAD, SAILING, UPKEEP, Minute
from hil.__main__ import main
from hil.errors import UsageError
from hil.report import field_log, field_page, log_records, thin_log
from hil.report.log_records import LogContents, LogFile
from hil.report.voyages import field_voyage
from support.paths import REPLAY, ROOT

LOG = REPLAY / "tank_pni_volz.BIN"
MINUTE = Minute(
    utc_s=1.8e9, span_s=60.0, mode=15, armed=True, faults=0, latitude_rad=0.6, longitude_rad=2.1, rms_error_rad=0.02,
    travel_rad=0.1, steering_j=36.0, wave_period_s=6.0, servo_c=20.0,
)  # fmt: skip


def thin_bytes(minutes):
    rows = [SAILING.pack(60.0 * n, minute) + UPKEEP.pack(60.0 * n, minute) for n, minute in enumerate(minutes)]
    return HEAD + b"".join(rows)


@pytest.fixture
def state(tmp_path):
    """A state directory with five full logs and a thin log of three days, the last with a fault."""
    logs = tmp_path / "state/logs"
    (logs / "thin").mkdir(parents=True)
    for number in range(1, 6):
        shutil.copy(LOG, logs / f"{number:08d}.BIN")
    minutes = [
        replace(MINUTE, utc_s=1.8e9 + 60.0 * n, latitude_rad=0.6 + 1e-7 * n, faults=int(n > 4000)) for n in range(4320)
    ]
    (logs / "thin/00000001.BIN").write_bytes(thin_bytes(minutes))
    return tmp_path / "state"


def test_log_has_the_columns_of_a_recorded_truth():
    log = field_log.read([LOG])
    truth = log.truth
    assert np.all(np.diff(truth.time_s) > 0.0)
    assert all(np.isfinite(getattr(truth, name)).all() for name in ("heading_low_rad", "rudder_rad", "north_m"))
    assert np.abs(np.diff(truth.heading_low_rad)).max() < 1.0
    assert log.ticks == truth.time_s.size
    assert sum(period.seconds for period in log.mode_periods) == pytest.approx(
        truth.time_s[-1] - truth.time_s[0], abs=1.0
    )
    assert log.texts
    assert np.nanmax(log.columns["ground_m_s"]) > 0.1
    assert np.isfinite(log.columns["wave_period_s"][10:]).all()
    assert log.home == log.origin
    assert log.late_us["p50"] <= log.late_us["p99"] <= log.late_us["max"]


def test_logs_of_two_starts_are_joined():
    log, joined = field_log.read([LOG]), field_log.read([LOG, LOG])
    assert joined.ticks == pytest.approx(2 * log.ticks, abs=1)
    assert np.all(np.diff(joined.truth.time_s) > 0.0)
    assert joined.truth.time_s[-1] == pytest.approx(2.0 * log.truth.time_s[-1] - log.truth.time_s[0], rel=0.01)


def test_logs_have_the_times_of_their_dates(tmp_path, monkeypatch):
    """The second log begins 300 s after the end of the first; the third has no date."""
    single = field_log.read([LOG])
    length_s = float(single.truth.time_s[-1])
    begin_s = 1.8e9
    dates = iter([begin_s, begin_s + length_s + 300.0, None] * 2)
    monkeypatch.setattr(log_records, "utc_offset_s", lambda _data: next(dates))
    log = field_log.read([LOG] * 3)
    second, third = (float(log.truth.time_s[row]) for row in log.cuts)
    assert second == pytest.approx(length_s + 300.0)
    assert third == pytest.approx(2.0 * length_s + 300.1)
    seconds = sum(period.seconds for period in log.mode_periods)
    assert seconds == pytest.approx(3.0 * sum(period.seconds for period in single.mode_periods), rel=0.01)
    assert [field_page._clock(t_s, log) for t_s in (10.0, second + 10.0, third + 10.0)] == [
        "2027-01-15 08:00:10", field_page._calendar(begin_s + second + 10.0), f"{LOG.name} 10.0 s"
    ]  # fmt: skip
    assert log.axis_utc_s() is None
    columns = field_voyage(log)["columns"]
    assert sum(rudder is None for rudder in columns["rudder_deg"]) == 2
    field_page.write([LOG] * 3, tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert f"{LOG.name}: 300 s without a log before it" in text
    assert not re.search(r"(from|deg at) \d+ s<", text)
    assert f"{LOG.name}: unknown time since the previous log" in text
    assert field_page._calendar(begin_s + length_s + 300.0 + single.texts[-1][0]) in text


def test_lateness_has_percentiles_in_microseconds():
    contents = LogContents()
    file = LogFile(LOG, contents)
    for k in range(1001):
        file._add_tick(0.1 * k, k * 1e-6, 2.0 * (k == 1000))
    file._store_row()
    log = field_log._assemble(contents)
    assert (log.ticks, log.skipped) == (1001, 2)
    assert {name: round(value, 6) for name, value in log.late_us.items()} == {
        "p50": 500.0, "p99": 990.0, "p99.9": 999.0, "max": 1000.0
    }  # fmt: skip


def test_log_that_continues_another_has_its_date():
    contents = LogContents()
    for t_s, date in ((0.0, 1.8e9), (100.0, None), (200.0, 1.8e9 + 20.0), (201.0, 1.9e9)):
        file = LogFile(LOG, contents)
        file._utc_shift_s = date
        file._add_tick(t_s, 0.0, 0.0)
        file._store_row()
    assert [segment.utc_s for segment in contents.segments] == [1.8e9, 1.8e9, 1.8e9 + 20.0, 1.8e9]
    assert [segment.gap_s for segment in contents.segments] == [0.0, 100.0, 100.0, 1e8 + 1.0]


def test_page_is_self_contained(state, tmp_path, capsys):
    assert main(["report", str(state), "--out", str(tmp_path / "page.html")]) == 0
    assert capsys.readouterr().out == f"report: {tmp_path / 'page.html'}\n"
    text = (tmp_path / "page.html").read_text()
    assert text.count('class="voyage"') == 2
    assert not re.search(r'(?:src|href)="(?!data:)|url\(|@import', text)
    words = re.sub(r"<[^>]+>", " ", text)
    for part in ("Figures", "duration", "Settings", "Day by day", "2027-01-15", "latest 3 of 5"):
        assert part in words


@pytest.mark.parametrize("damage", ["missing", "without a tick", "empty"])
def test_thin_log_is_shown_without_readable_full_logs(state, tmp_path, damage):
    for log in (state / "logs").glob("*.BIN"):
        log.unlink()
        if damage == "without a tick":
            log.write_bytes(header((), 0))
        elif damage == "empty":
            log.touch()
    assert main(["report", str(state), "--out", str(tmp_path / "page.html")]) == 0
    text = (tmp_path / "page.html").read_text()
    assert "Day by day" in text
    assert ("The full logs are not included" in text) == (damage != "missing")


def test_day_rows_contain_the_sums_of_a_day(state):
    table = thin_log.read([state / "logs/thin/00000001.BIN"])
    head, *rows = thin_log.day_rows(table)
    assert len(rows) == 4  # three days that begin at 08:00
    day = dict(zip(head, rows[1], strict=True))
    assert day["logged"] == day["armed"] == "24.0 h"
    assert day["servo energy"] == f"{1440 * 36.0 / 3600.0:.2f} Wh"
    assert day["rudder travel"] == f"{math.degrees(144.0):.0f} deg"
    assert day["rms error"] == f"{math.degrees(0.02):.1f} deg"
    assert day["made good"] == f"{1439 * 1e-7 * 6371.0088:.1f} km"
    assert sum(float(row[head.index("faults")].split()[0]) for row in rows) == 4320 - 4001


def test_distance_made_good_is_that_of_the_day(tmp_path):
    """The second log has 101 minutes of a later day: the boat sails east across the date line at 60 deg north."""
    north_rad = math.radians(60.0)
    equator = replace(MINUTE, latitude_rad=0.0, longitude_rad=0.0)
    noon_s = 1.8e9 + 2 * 86400.0
    east = [
        replace(
            MINUTE, utc_s=noon_s + 60.0 * n, latitude_rad=north_rad, longitude_rad=math.remainder(lng_rad, math.tau)
        )
        for n in range(101)
        for lng_rad in (math.pi + 1e-6 * (n - 50),)
    ]
    (tmp_path / "1.BIN").write_bytes(thin_bytes([equator]))
    (tmp_path / "2.BIN").write_bytes(thin_bytes(east))
    head, *rows = thin_log.day_rows(thin_log.read([tmp_path / "1.BIN", tmp_path / "2.BIN"]))
    assert rows[-1][head.index("made good")] == f"{1e-4 * math.cos(north_rad) * 6371.0088:.1f} km"


def test_rows_of_impossible_times_are_skipped(tmp_path):
    paths = []
    for number, utc_s in enumerate((1.8e9, math.nan, 0.0, -1.0, 1e300, 946_684_860.0, 1.8e9 + 60.0)):
        paths.append(tmp_path / f"{number}.BIN")
        paths[-1].write_bytes(thin_bytes([replace(MINUTE, utc_s=utc_s)]))
    table = thin_log.read(paths)
    assert (table.rows, table.undated_s) == (2, 300.0)


def test_gap_of_more_than_ten_minutes_interrupts_the_line():
    columns = thin_log.with_breaks(time_s := np.array([0.0, 600.0, 1201.0]), {"x": time_s}, thin_log.gap_rows(time_s))
    assert [math.isnan(x) for x in columns["x"]] == [False, False, True, False]
    assert columns["time_s"][2] == 900.5


def test_undated_time_is_reported_on_the_page(tmp_path):
    (tmp_path / "thin").mkdir()
    (tmp_path / "thin/00000001.BIN").write_bytes(thin_bytes([replace(MINUTE, utc_s=60.0 * n) for n in range(1, 91)]))
    field_page.write([tmp_path], tmp_path / "page.html")
    assert "1.5 h of the thin log have no date" in (tmp_path / "page.html").read_text()


def test_logs_of_a_run_directory_are_found(state, tmp_path):
    (tmp_path / "run").mkdir()
    shutil.move(state, tmp_path / "run/state")
    full, thin, _ = field_page.find_logs([tmp_path / "run"])
    assert ([path.name for path in full], len(thin)) == ([f"{n:08d}.BIN" for n in (3, 4, 5)], 1)


def test_other_file_gives_an_error_of_one_line(tmp_path, capsys):
    (tmp_path / "text.BIN").write_text("hello")
    (tmp_path / "empty.BIN").write_bytes(header((), 0))
    (tmp_path / "empty").mkdir()
    for name in ("text.BIN", "empty.BIN", "empty", "missing"):
        assert main(["report", str(tmp_path / name), "--out", str(tmp_path / "page.html")]) == 2
        text = capsys.readouterr().err
        assert text.count("\n") == 1
        assert name in text
    assert main(["report", str(LOG), "--out", str(tmp_path / "no/page.html")]) == 2


def test_damaged_logs_are_read_as_far_as_possible():
    log = LOG.read_bytes()
    rng = random.Random(20180825)
    for _ in range(12):
        data = bytearray(log[: rng.randrange(1, len(log))])
        for _ in range(rng.randrange(40)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        contents = LogContents()
        LogFile(LOG, contents).read(bytes(data))
        if contents.columns["time_s"]:
            assert np.isfinite(field_log._assemble(contents).truth.heading_low_rad).all()


def test_page_needs_no_packages_of_the_harness(state, tmp_path):
    code = (
        "import sys\n"
        "for name in ('matplotlib', 'scipy', 'numba', 'rich', 'cma'): sys.modules[name] = None\n"
        "from hil.__main__ import main; sys.exit(main(sys.argv[1:]))"
    )
    words = [sys.executable, "-c", code, "report", str(state), "--out", str(tmp_path / "page.html")]
    assert subprocess.run(words, check=False, cwd=ROOT).returncode == 0
    assert (tmp_path / "page.html").exists()


def test_rambler_report_names_itself_in_errors(tmp_path, capsys):
    assert rambler.main(["report", str(tmp_path / "MISSING")]) == 2
    assert capsys.readouterr().err.startswith(f"rambler report: {tmp_path / 'MISSING'} does not exist; ")


def test_rambler_report_calls_the_harness(monkeypatch):
    calls = []
    monkeypatch.setattr(
        "subprocess.run", lambda words, **_: calls.append(words) or subprocess.CompletedProcess(words, 0, stderr="")
    )
    assert rambler.main(["report", "a.BIN", "b.BIN", "--out", "page.html"]) == 0
    assert calls[0][1:] == ["-m", "hil", "report", "--out", "page.html", "--", "a.BIN", "b.BIN"]


def test_log_without_a_tick_raises_an_error(tmp_path):
    (tmp_path / "a.BIN").write_bytes(b"")
    with pytest.raises(UsageError, match=r"a\.BIN"):
        field_log.read([tmp_path / "a.BIN"])


def test_run_of_an_old_version_shows_its_logs_only(state, tmp_path, capsys):
    (tmp_path / "run").mkdir()
    shutil.move(state, tmp_path / "run/state")
    for has_truth in (False, True):
        assert main(["report", str(tmp_path / "run"), "--out", str(tmp_path / "page.html")]) == 0
        assert ("no run.json, because an old version made the run" in capsys.readouterr().err) == has_truth
        (tmp_path / "run/truth.csv").touch()
