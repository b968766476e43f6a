"""`rambler-hil estimate` over tables and logs, end to end."""

import json
import math

import numpy as np
import pytest

from hil.__main__ import main
from hil.lab.estimate import page
from support.ardupilot_log import log_bytes
from support.paths import ROOT
from support.recorded_sea import sea, text_of

CONTRACT = [
    *("time_s", "heading_rad", "heading_sd_rad", "yaw_rate_rad_s", "yaw_rate_sd_rad_s", "rudder_bias_rad"),
    *("rudder_bias_sd_rad", "speed_m_s", "speed_sd_m_s", "current_north_m_s", "current_east_m_s", "current_sd_m_s"),
    *("leeway_rad", "wave_period_s", "wave_yaw_rad", "compass_noise_rad", "innovation_rad", "innovation_sd_rad"),
    *("heading_in_5_s_rad", "heading_in_5_s_sd_rad", "heading_in_10_s_rad", "heading_in_10_s_sd_rad"),
    *("heading_in_30_s_rad", "heading_in_30_s_sd_rad", "heading_in_60_s_rad", "heading_in_60_s_sd_rad"),
]
LARGEST_RMS_DEG = 0.8  # of the heading; a low-passed compass is off by 0.65 at best
LOGS = ROOT / "tests" / "replay" / "data"


def off_deg(one, other):
    return np.degrees((one - other + math.pi) % math.tau - math.pi)


def first_rows(recorded, count):
    return {name: values[:count].copy() for name, values in recorded.columns.items()}


def test_a_row_for_each_heading_with_the_columns_of_the_contract(recorded, whole):
    columns, _ = whole
    assert list(columns) == CONTRACT
    assert columns["time_s"].tolist() == recorded.columns["time_s"].tolist()


def test_the_heading_estimate_is_that_of_the_hull(recorded, whole):
    columns, summary = whole
    late = columns["time_s"] > 200.0
    error = off_deg(columns["heading_rad"], recorded.hull_rad)[late]
    rms_deg = np.sqrt(np.mean(error**2))
    assert rms_deg < LARGEST_RMS_DEG
    assert 0.4 < np.mean((np.radians(error) / columns["heading_sd_rad"][late]) ** 2) < 1.8
    # Judged by the recording itself, it comes to nearly the same.
    assert summary["heading"]["rms_error_deg"] == pytest.approx(rms_deg, rel=0.3)
    assert 0.4 < summary["heading"]["nees"] < 1.8
    assert summary["heading"]["rms_error_deg"] < summary["heading"]["best_low_pass_rms_error_deg"]
    assert abs(summary["innovations"]["autocorrelation_lag_1"]) < 0.15
    yaw = off_deg(recorded.columns["heading_rad"], columns["heading_rad"] + columns["wave_yaw_rad"])[late]
    assert np.sqrt(np.mean(yaw**2)) < 0.2


def test_predictions_explain_what_the_rudder_does(recorded, whole):
    columns, summary = whole
    for seconds in (5, 10, 30, 60):
        predicted, sd = columns[f"heading_in_{seconds}_s_rad"], columns[f"heading_in_{seconds}_s_sd_rad"]
        rows = (columns["time_s"] > 200.0) & (columns["time_s"] < 399.0 - seconds)
        assert np.isfinite(predicted[rows] + sd[rows]).all()
        later = np.interp(columns["time_s"] + seconds, columns["time_s"], recorded.hull_rad)
        miss = off_deg(predicted, later)[rows]
        figures = summary["predictions"][f"{seconds}_s"]
        assert figures["rms_error_deg"] == pytest.approx(np.sqrt(np.mean(miss**2)), rel=0.2)
        assert figures["r2_against_persistence"] > 0.4
        assert figures["r2_against_low_passed_compass"] > 0.4
        assert 0.4 < figures["nees"] < 2.5


def test_the_summary(whole):
    _, summary = whole
    assert (summary["headings"], summary["rate_hz"], summary["judged_from_s"]) == (800, 2.0, 199.75)
    assert summary["ship"] == {"K": 0.049, "T": 4.0, "alpha": 0.0, "speed": 0.5}
    assert summary["recorded_waves"]["period_s"] == pytest.approx(2.5, rel=0.1)
    assert summary["recorded_waves"]["yaw_sd_deg"] == pytest.approx(1.1, rel=0.25)
    assert summary["rudder_travel_commanded_deg_per_h"] > 0.0
    assert summary["rudder_travel_recorded_deg_per_h"] > 1000.0
    assert summary["heading"]["best_low_pass_rms_error_deg"] < summary["heading"]["compass_rms_error_deg"]
    assert summary["faults"] == []


def test_the_same_recording_gives_the_same_estimate(recorded, estimated):
    few = first_rows(recorded, 200)
    (columns, summary), (others, other) = estimated(few), estimated(few)
    assert all(np.array_equal(columns[name], others[name], equal_nan=True) for name in columns)
    summary["file"] = other["file"]
    assert summary == other


def test_degrees_and_a_late_clock_are_the_same_recording(recorded, estimated):
    columns = first_rows(recorded, 200)
    known, _ = estimated(columns)
    for name in ("heading", "rudder"):
        columns[f"{name}_deg"] = np.degrees(columns.pop(f"{name}_rad"))
    columns["time_s"] = columns["time_s"] + 1.7e9
    text = text_of(columns | {"time_s": [repr(time_s) for time_s in columns["time_s"].tolist()]})
    found, summary = estimated(text)
    assert found["time_s"].tolist() == columns["time_s"].tolist()
    assert np.max(np.abs(off_deg(found["heading_rad"], known["heading_rad"]))) < 1e-3
    assert summary["from_s"] == 1.7e9


@pytest.mark.parametrize(
    "left",
    [
        ("time_s", "heading_rad"),
        ("time_s", "heading_rad", "rudder_rad"),
        pytest.param(("time_s", "heading_rad", "lat_deg", "lon_deg"), marks=pytest.mark.proof),
        pytest.param(("time_s", "heading_rad", "sog_m_s", "cog_deg"), marks=pytest.mark.proof),
    ],
)
def test_optional_columns(recorded, estimated, left):
    found, summary = estimated({name: recorded.columns[name] for name in left})
    late = found["time_s"] > 200.0
    assert np.sqrt(np.mean(off_deg(found["heading_rad"], recorded.hull_rad)[late] ** 2)) < LARGEST_RMS_DEG
    assert summary["rudder_recorded"] == ("rudder_rad" in left)
    if "rudder_rad" not in left:
        assert np.isnan(found["heading_in_10_s_rad"]).all()
        assert summary["rudder_travel_recorded_deg_per_h"] is None
    if "lat_deg" not in left and "sog_m_s" not in left:
        assert summary["positions"] == 0


def test_a_gap_in_the_headings_is_a_fault_and_no_row(recorded, estimated):
    time_s = recorded.columns["time_s"]
    rows = (time_s < 200.0) | (time_s > 260.0)
    found, summary = estimated({name: values[rows] for name, values in recorded.columns.items()})
    assert found["time_s"].size == np.count_nonzero(rows)
    lost = [fault for fault in summary["faults"] if fault["name"] == "COMPASS_SILENT"]
    assert len(lost) == 1
    assert 200.0 < lost[0]["from_s"] < 205.0
    assert 260.0 < lost[0]["to_s"] < 263.0


def test_empty_cells(recorded, estimated):
    columns = first_rows(recorded, 300)
    columns["heading_rad"][100:110] = np.nan
    for name, every in (("rudder_rad", 2), ("lat_deg", 5), ("lon_deg", 5), ("sog_m_s", 5), ("cog_deg", 5)):
        columns[name][np.arange(300) % every != 0] = np.nan
    found, summary = estimated(columns)
    assert found["time_s"].size == 290
    assert summary["positions"] == 60
    assert np.isfinite(found["heading_rad"]).all()


def test_a_recording_with_a_high_rate(estimated):
    fast = sea(seconds=40.0, rate_hz=20.0)
    found, summary = estimated(fast.columns)
    assert (found["time_s"].size, summary["rate_hz"]) == (800, 20.0)
    assert np.sqrt(np.mean(off_deg(found["heading_rad"], fast.hull_rad)[400:] ** 2)) < LARGEST_RMS_DEG


def test_a_recorded_goal_is_the_commanded_heading(recorded, estimated):
    few = first_rows(recorded, 200)
    _, near = estimated(few)
    _, far = estimated({**few, "goal_rad": np.full(200, 1.0)})
    assert far["rudder_travel_commanded_deg_per_h"] != near["rudder_travel_commanded_deg_per_h"]


def test_the_speed_source_is_noted(recorded, estimated):
    columns = {name: recorded.columns[name][:200] for name in ("time_s", "heading_rad")}
    speed = np.full(200, 0.62)
    _, water = estimated({**columns, "speed_m_s": speed}, "--ship", "K=0.049,T=4")
    assert water["ship"]["speed"] == pytest.approx(0.62)
    assert any("mean speed through the water, 0.62 m/s" in note for note in water["notes"])
    _, ground = estimated({**columns, "sog_m_s": speed}, "--ship", "K=0.049,T=4,speed=0.4")
    assert ground["ship"]["speed"] == pytest.approx(0.4)
    assert any(note.startswith("initial speed: mean speed over ground") for note in ground["notes"])


def test_parameters_of_files(recorded, estimated, tmp_path):
    params, vehicle = tmp_path / "boat.parm", tmp_path / "boat.toml"
    params.write_text("MDL_K 0.1\nFS_RUD_ACT 1\n")
    device = 'driver = "{}"\nport = "x"\nbaud = 38400\n'
    vehicle.write_text(
        f"[compass]\n{device.format('nmea')}[rudder]\n{device.format('volz')}id = 1\n[parameters]\nMDL_T_S = 7.0\n"
    )
    few = first_rows(recorded, 200)
    _, summary = estimated(few, "--params", str(params), "--vehicle", str(vehicle))
    assert summary["ship"] == {"K": 0.1, "T": 7.0, "alpha": 17.0, "speed": 0.4}


def test_an_onboard_log(estimated):
    found, summary = estimated((LOGS / "tank.BIN").read_bytes())
    assert found["time_s"].size == summary["headings"] == 600
    assert summary["rudder_recorded"]
    assert summary["positions"] == 59
    assert summary["faults"] == []


def test_an_onboard_log_with_a_compass_failure(estimated):
    _, summary = estimated((LOGS / "second_compass.BIN").read_bytes())
    assert [fault["name"] for fault in summary["faults"]] == ["COMPASS_SILENT"]


def test_a_log_of_ardupilot(recorded, estimated):
    columns = recorded.columns
    rate = np.gradient(recorded.hull_rad, columns["time_s"])
    fixes = np.stack([columns[name] for name in ("lat_deg", "lon_deg", "cog_deg", "sog_m_s")], axis=1)
    log = log_bytes(
        *(columns[name] for name in ("time_s", "rudder_rad", "heading_rad")), rate, pulses=True, fixes=fixes
    )
    found, summary = estimated(log)
    assert found["time_s"][0] == 5.0
    late = found["time_s"] > 200.0
    assert np.sqrt(np.mean(off_deg(found["heading_rad"], recorded.hull_rad)[late] ** 2)) < LARGEST_RMS_DEG
    assert summary["positions"] == 800
    assert summary["recorded_speed_over_ground_m_s"] == pytest.approx(np.mean(columns["sog_m_s"]), rel=1e-3)


def test_json_to_standard_output(recorded, tmp_path, capsys):
    path = tmp_path / "table.csv"
    path.write_text(text_of(first_rows(recorded, 100)))
    assert main(["estimate", str(path), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["headings"] == 100


def test_the_page_is_self_contained(recorded, estimated, tmp_path):
    path = tmp_path / "page.html"
    few = first_rows(recorded, 300)
    _, summary = estimated(few, "--page", str(path))
    text = path.read_text()
    assert "http" not in text.replace("http-equiv", "").replace("http://www.w3.org/", "")
    block = text.split('<script type="application/json" class="voyage">')[1].split("</script>")[0]
    voyage = json.loads(block)
    assert voyage["columns"]["time_s"] == recorded.columns["time_s"][:300].tolist()
    plotted = {line["column"] for panel in voyage["panels"] for line in panel["lines"]}
    assert plotted <= voyage["columns"].keys()
    assert voyage["spectrum"]["marks"]
    assert f"{summary['heading']['rms_error_deg']:.3g}" in text


def test_a_long_recording_is_thinned_on_the_page(estimated, tmp_path, monkeypatch):
    monkeypatch.setattr(page, "MAX_ROWS", 100)
    path = tmp_path / "page.html"
    estimated(sea(seconds=150.0).columns, "--page", str(path))
    voyage = json.loads(path.read_text().split('class="voyage">')[1].split("</script>")[0])
    assert len(voyage["columns"]["time_s"]) == 100


GOOD = {"time_s": np.arange(50) * 0.5, "heading_rad": np.linspace(0.1, 0.2, 50)}
CELLS = {name: [f"{value:.4f}" for value in values] for name, values in GOOD.items()}


def changed(name, row, text):
    return {**CELLS, name: [*CELLS[name][:row], text, *CELLS[name][row + 1 :]]}


@pytest.mark.parametrize(
    ("columns", "error_text"),
    [
        ({"time_s": CELLS["time_s"]}, ":1: missing column heading_rad; name the columns time_s,"),
        ({"heading_rad": CELLS["heading_rad"]}, ":1: missing column time_s"),
        (changed("heading_rad", 3, "north"), ":5: heading_rad 'north' is not a finite number; remove the row"),
        (changed("heading_rad", 3, "inf"), ":5: heading_rad 'inf' is not a finite number"),
        (changed("time_s", 30, "2.0"), ":32: time_s 2 is not later than 14.5; sort the rows by time"),
        (changed("time_s", 30, "soon"), ":32: time_s 'soon' is not a time"),
        ({**CELLS, "heading_rad": ["nan"] * 50}, ":2: heading_rad has 0 headings; give at least 20"),
        ({**CELLS, "rudder_deg": ["100"] * 50}, ":2: rudder_deg is 100 deg, beyond 90 deg"),
        ({**CELLS, "rudder_percent": ["10"] * 50}, ": rudder_percent is not an angle"),
        ({**CELLS, "lat_deg": ["91"] * 50, "lon_deg": ["1"] * 50}, ":2: lat_deg 91 is beyond 90.01"),
        (
            {**CELLS, "heading_rad": [str(350 + n) if n < 10 else str(n - 10) for n in range(50)]},
            "name the column heading_deg",
        ),
        ({**CELLS, "time_s": [str(500 * n) for n in range(50)]}, ": the headings are 500 s apart; give at most 5 s"),
        ({name: cells[:5] for name, cells in CELLS.items()}, ": 5 rows below the column names"),
    ],
)
def test_errors_of_a_table(tmp_path, capsys, columns, error_text):
    path = tmp_path / "table.csv"
    path.write_text(text_of(columns))
    assert main(["estimate", str(path)]) == 2
    error = capsys.readouterr().err
    assert f"{path}" in error
    assert error_text in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "error_text"),
    [
        (["--ship", "K=fast"], "--ship: K=fast is not a number"),
        (["--ship", "K=0.05,K=0.06"], "--ship: K is given twice"),
        (["--ship", "k=0.05"], "--ship: 'k=0.05' is unknown; use K=, T=, alpha=, speed="),
        (["--ship", "T=-1"], "--ship T: MDL_T_S: -1 is out of range; allowed: 0.05 to 5000 s"),
        (["--params", "missing.parm"], "--params missing.parm cannot be read"),
        (["--out", "no/where.csv"], "--out no/where.csv: directory"),
    ],
)
def test_errors_of_options(tmp_path, monkeypatch, capsys, arguments, error_text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "table.csv").write_text(text_of(CELLS))
    assert main(["estimate", "table.csv", *arguments]) == 2
    assert error_text in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"", b"no log at all" * 100])
def test_an_invalid_log(tmp_path, capsys, content):
    path = tmp_path / "x.BIN"
    path.write_bytes(content)
    assert main(["estimate", str(path)]) == 2
    assert f"{path}: contains 0 headings" in capsys.readouterr().err


def test_a_missing_file(tmp_path, capsys):
    assert main(["estimate", str(tmp_path / "x.BIN")]) == 2
    assert main(["estimate", str(tmp_path / "x.csv")]) == 2
    assert capsys.readouterr().err.count("No such file") == 2
