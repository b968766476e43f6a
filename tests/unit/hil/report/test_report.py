"""Summary, page and text of a constructed run."""

import json
import re
import shutil
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firmware_py.common.angles import radians
from hil.__main__ import main
from hil.report import run_page, summary
from hil.report.figures import goal_figures
from hil.report.text import figures_text
from hil.report.thinning import MAX_POINTS, thin_truth
from hil.ship import scenarios
from hil.sim.goals import parse_goals
from hil.sim.run_directory import locked_directory
from hil.sim.run_file import FINISHED, UNDER_WAY, OrderRecord, RunFile, read, versions
from hil.sim.truth import COLUMNS, Truth, TruthFile
from hil.sim.world import World
from support.paths import REPLAY

RECORD = RunFile(
    command=("rambler-hil", "run", "tank"),
    begun="2026-01-01 00:00:00 UTC",
    title="tank: a tank",
    scenario="tank",
    extras="",
    sea=(("current", "none"),),
    seed=1,
    seconds=300.0,
    compass="nmea",
    servo="dynamixel",
    settings={"CTL_K1": 30.0},
    lockstep=True,
    start_utc_s=1.8e9,
    versions={"numpy": "2"},
    ending=FINISHED,
    orders=(OrderRecord("goal 30 deg at 60 s", 60.0, 60.0, 60.02),),
    arrivals=((30.5, 1), (30.5, 2)),
    wall_s=3.0,
)


@pytest.fixture(scope="module")
def run_directory(tmp_path_factory):
    """The directory of a constructed run."""
    directory = tmp_path_factory.mktemp("run")
    truth = TruthFile(directory / "truth.csv")
    world = World(scenarios.find_scenario("tank"), 1, parse_goals("0:0,60:30"), end_s=300.0, truth=truth)
    world.shaft.set_torque(on=True)
    world.advance_to(60.0)
    world.shaft.set_target(radians(20.0))
    world.advance_to(95.0)
    world.shaft.set_target(0.0)
    world.advance_to(300.0)
    truth.close()
    RECORD.write(directory)
    return directory


@pytest.fixture
def out(run_directory, tmp_path):
    """A copy of the directory of the run."""
    return shutil.copytree(run_directory, tmp_path, dirs_exist_ok=True)


def test_summary_contains_the_figures(out):
    figures = summary.summarise(RECORD, out)
    keys = "overshoot_deg settling_s mean_error_deg rms_error_deg p95_error_deg steady_from_s"
    assert set(figures["goals"][1]) >= set(keys.split())
    assert figures["goals"][1]["accepted_s"] == 60.02
    assert figures["goals"][0]["accepted_s"] is None
    assert figures["goals"][1]["step_deg"] == pytest.approx(30.0, abs=0.01)
    assert figures["speed_ratio"] == 100.0
    assert figures["with"] == ""
    assert figures["loop"] is None
    assert figures["events"] == []
    assert figures["arrivals"] == [{"time_s": 30.5, "item": 1}, {"time_s": 30.5, "item": 2}]
    assert read(out) == RECORD
    assert figures["settings"] == {"CTL_K1": 30.0}
    assert figures["rudder_travel_deg_per_h"] == 0.0
    assert figures["rudder_travel_whole_deg_per_h"] == pytest.approx(40.0 * 12.0, rel=0.01)
    summary.write(figures, out)
    assert json.loads((out / "summary.json").read_text()) == figures


def test_summary_contains_texts_and_loop_of_the_log(out):
    (out / "state/logs").mkdir(parents=True)
    shutil.copy(REPLAY / "tank_pni_volz.BIN", out / "state/logs/00000001.BIN")
    log = summary.read_onboard_logs(out)
    figures = summary.summarise(RECORD, out, log)
    assert (figures["loop"]["ticks"], figures["loop"]["lateness_us"]) == (log.ticks, None)
    assert "lockstep" in figures["loop"]["note"]
    in_real_time = summary.summarise(replace(RECORD, lockstep=False), out, log)
    assert in_real_time["loop"]["lateness_us"].keys() == log.late_us.keys()
    events = figures["events"]
    assert {"time_s", "severity", "text"} == set(events[0])
    armed = next(event for event in events if event["text"] == "Armed")
    assert 0.0 < armed["time_s"] < 10.0
    assert armed["severity"] == 5


def test_page_is_self_contained(out):
    figures, path = run_page.make(out)
    text = Path(path).read_text(encoding="utf-8")
    assert (out / "run.png").read_bytes().startswith(b"\x89PNG")
    assert not re.search(r'(src|href)="(?!data:)|url\(|@import', text)
    assert "30 deg at 60 s" in text
    assert "CTL_K1" in text
    for part in ("rambler-hil run tank", "2026-01-01", "numpy 2", f"rambler-hil report {out}"):
        assert part in text
    columns = json.loads(re.search(r'class="voyage">(.*?)</script>', text)[1])["columns"]
    assert len(columns["heading_deg"]) == len(columns["time_s"]) == 3001
    assert columns["goal_deg"][-1] == 30.0
    assert json.loads((out / "summary.json").read_text()) == figures


def test_text_contains_loop_and_unsettled_goal(out):
    figures = summary.summarise(RECORD, out)
    figures["loop"] = {"ticks": 9, "skipped": 1, "lateness_us": {"p50": 60.0, "max": 200.0}, "note": ""}
    figures["goals"][0]["settling_s"] = None
    text = figures_text(figures)
    assert "9 ticks, 1 skipped; lateness of ticks p50 60 us, max 200 us; 100.0 x real time" in text
    assert "never" in text


@pytest.mark.usefixtures("without_picture")
@pytest.mark.parametrize("content", ["", "time_", "header", "half"])
def test_page_of_an_incomplete_run_states_it(out, content):
    whole = (out / "truth.csv").read_text()
    contents = {"header": whole[: whole.index("\n") + 1], "half": whole[: len(whole) // 2 - 3]}
    (out / "truth.csv").write_text(contents.get(content, content))
    replace(RECORD, ending=UNDER_WAY, orders=(), wall_s=None).write(out)
    figures, path = run_page.make(out)
    assert (len(figures["goals"]) > 0) == (content == "half")
    assert figures["speed_ratio"] is None
    assert (figures["rudder_travel_whole_deg_per_h"] is None) == (content != "half")
    text = "speed unknown" if content == "half" else "empty run, no figures: under way"
    assert text in figures_text(figures)
    assert text in path.read_text()
    assert "Ended early: no end recorded" in Path(path).read_text(encoding="utf-8")


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"orders": 1}', "\x00"])
def test_directory_without_a_run_gives_an_error_of_one_line(out, text, capsys):
    (out / "run.json").write_text(text)
    assert main(["report", str(out)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.usefixtures("without_picture")
def test_page_is_written_again_with_the_versions(out, capsys):
    assert main(["report", str(out)]) == 0
    text = capsys.readouterr().out
    assert f"report: {out / 'report.html'}" in text
    assert "overshoot" in text
    assert json.loads((out / "summary.json").read_text())["versions"] == {"numpy": "2"}
    assert json.loads((out / "summary.json").read_text())["figures_by"] == versions()
    assert "versions of the figures" in (out / "report.html").read_text()
    replace(RECORD, versions=versions()).write(out)
    assert main(["report", str(out)]) == 0
    assert "figures_by" not in json.loads((out / "summary.json").read_text())
    assert "versions of the figures" not in (out / "report.html").read_text()


def test_locked_directory_is_not_changed(out, capsys):
    with locked_directory(out):
        assert main(["report", str(out)]) == 2
        assert "another run is under way" in capsys.readouterr().err
        assert main(["run", "calm", "--seconds", "1", "--out", str(out)]) == 2
        assert "another run is under way" in capsys.readouterr().err
    assert read(out) == RECORD


@pytest.mark.parametrize("rows", [36_001, 86_401, 864_001])
def test_thinning_keeps_peaks(rows):
    columns = np.random.default_rng(1).normal(size=(len(COLUMNS), rows))
    columns[0] = np.arange(rows) / 10.0
    whole = Truth(*columns)
    pieces = [Truth(*(column[cut : cut + 4096] for column in columns)) for cut in range(0, rows, 4096)]
    thinned = thin_truth(pieces, rows)
    assert thinned.time_s.size <= 1.1 * MAX_POINTS + 2
    assert np.all(np.diff(thinned.time_s) >= 0.0)
    assert (thinned.time_s[0], thinned.time_s[-1]) == (0.0, whole.time_s[-1])
    assert (thinned.heading_rad.min(), thinned.heading_rad.max()) == (whole.heading_rad.min(), whole.heading_rad.max())
    assert np.array_equal(thin_truth((pieces[0],), 4096).heading_rad, pieces[0].heading_rad)


class LongTruth:
    """A truth of any length with one goal that is generated in pieces."""

    def __init__(self, rows):
        self.rows = rows

    def __iter__(self):
        rng = np.random.default_rng(1)
        for first in range(0, self.rows, 4096):
            time_s = np.arange(first, min(first + 4096, self.rows)) / 10.0
            noise = rng.normal(size=(len(COLUMNS) - 1, time_s.size))
            noise[5] = 1.0
            yield Truth(time_s, *noise)


@pytest.mark.parametrize("read_all", [goal_figures, lambda truth: thin_truth(truth, truth.rows)])
def test_memory_does_not_grow_with_the_run(read_all):
    read_all(LongTruth(100))
    tracemalloc.start()
    try:
        read_all(LongTruth(864_001))  # one column is 7 MB
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak_bytes < 6e6


@pytest.mark.usefixtures("without_picture")
def test_disturbances_are_on_the_page(out):
    rows = scenarios.description_rows(scenarios.parse_scenario("tank+float=0.3:0.7,sway"))
    replace(RECORD, extras="float=0.3:0.7,sway=1", sea=tuple(rows)).write(out)
    figures, path = run_page.make(out)
    assert figures["with"] == "float=0.3:0.7,sway=1"
    assert "own frequency 0.3 rad/s, damping 0.7" in Path(path).read_text(encoding="utf-8")
