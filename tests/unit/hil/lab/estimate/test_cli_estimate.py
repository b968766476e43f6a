"""`rambler-hil estimate` over tables and logs, end to end."""

import json
import math

import numpy as np
import pytest
from msgspec.structs import replace

from firmware_py.common.records import RudderAngleSample
from firmware_py.common.reports import Output
from firmware_py.log import schema
from firmware_py.log.dataflash import header
from firmware_py.log.reader import LogReader
from hil.__main__ import main
from hil.lab.estimate import log_file, page
from support.ardupilot_log import log_bytes
from support.link import SNAPSHOT
from support.paths import ROOT
from support.recorded_sea import sea, text_of

CSV_COLUMNS = [
    *("time_s", "heading_rad", "heading_sd_rad", "yaw_rate_rad_s", "yaw_rate_sd_rad_s", "rudder_bias_rad"),
    *("rudder_bias_sd_rad", "speed_m_s", "speed_sd_m_s", "current_north_m_s", "current_east_m_s", "current_sd_m_s"),
    *("leeway_rad", "wave_period_s", "wave_yaw_rad", "compass_noise_rad", "innovation_rad", "innovation_sd_rad"),
    *("heading_in_5_s_rad", "heading_in_5_s_sd_rad", "heading_in_10_s_rad", "heading_in_10_s_sd_rad"),
    *("heading_in_30_s_rad", "heading_in_30_s_sd_rad", "heading_in_60_s_rad", "heading_in_60_s_sd_rad"),
]
MAX_RMS_DEG = 0.8  # of the heading; the best low-passed compass has 0.65
LOGS = ROOT / "tests" / "replay" / "data"


def difference_deg(first, second):
    return np.degrees((first - second + math.pi) % math.tau - math.pi)


def first_rows(recording, count):
    return {name: values[:count].copy() for name, values in recording.columns.items()}


def test_csv_has_a_row_for_each_heading_with_the_documented_columns(recording, whole_estimate):
    columns, _ = whole_estimate
    assert list(columns) == CSV_COLUMNS
    assert columns["time_s"].tolist() == recording.columns["time_s"].tolist()


def test_heading_estimate_is_near_the_heading_of_the_hull(recording, whole_estimate):
    columns, summary = whole_estimate
    is_late = columns["time_s"] > 200.0
    error = difference_deg(columns["heading_rad"], recording.hull_rad)[is_late]
    rms_deg = np.sqrt(np.mean(error**2))
    assert rms_deg < MAX_RMS_DEG
    assert 0.4 < np.mean((np.radians(error) / columns["heading_sd_rad"][is_late]) ** 2) < 1.8
    # The figures that the command computes without the true heading are similar.
    assert summary["heading"]["rms_error_deg"] == pytest.approx(rms_deg, rel=0.3)
    assert 0.4 < summary["heading"]["nees"] < 1.8
    assert summary["heading"]["rms_error_deg"] < summary["heading"]["best_low_pass_rms_error_deg"]
    assert abs(summary["innovations"]["autocorrelation_lag_1"]) < 0.15
    wave_error = difference_deg(recording.columns["heading_rad"], columns["heading_rad"] + columns["wave_yaw_rad"])[
        is_late
    ]
    assert np.sqrt(np.mean(wave_error**2)) < 0.2


def test_predictions_explain_most_heading_changes(recording, whole_estimate):
    columns, summary = whole_estimate
    for seconds in (5, 10, 30, 60):
        predicted, sd = columns[f"heading_in_{seconds}_s_rad"], columns[f"heading_in_{seconds}_s_sd_rad"]
        rows = (columns["time_s"] > 200.0) & (columns["time_s"] < 399.0 - seconds)
        assert np.isfinite(predicted[rows] + sd[rows]).all()
        later = np.interp(columns["time_s"] + seconds, columns["time_s"], recording.hull_rad)
        error = difference_deg(predicted, later)[rows]
        figures = summary["predictions"][f"{seconds}_s"]
        assert figures["rms_error_deg"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=0.2)
        assert figures["r2_against_persistence"] > 0.4
        assert figures["r2_against_low_passed_compass"] > 0.4
        assert 0.4 < figures["nees"] < 2.5


def test_summary_contains_recording_ship_waves_and_travel(whole_estimate):
    _, summary = whole_estimate
    assert (summary["headings"], summary["rate_hz"], summary["judged_from_s"]) == (800, 2.0, 199.75)
    assert summary["ship"] == {"K": 0.049, "T": 4.0, "alpha": 0.0, "speed": 0.5}
    assert summary["recorded_waves"]["period_s"] == pytest.approx(2.5, rel=0.1)
    assert summary["recorded_waves"]["yaw_sd_deg"] == pytest.approx(1.1, rel=0.25)
    assert summary["rudder_travel_commanded_deg_per_h"] > 0.0
    assert summary["rudder_travel_recorded_deg_per_h"] > 1000.0
    assert summary["heading"]["best_low_pass_rms_error_deg"] < summary["heading"]["compass_rms_error_deg"]
    assert summary["faults"] == []


def test_same_recording_gives_the_same_estimate(recording, estimate):
    short_recording = first_rows(recording, 200)
    (columns, summary), (other_columns, other_summary) = estimate(short_recording), estimate(short_recording)
    assert all(np.array_equal(columns[name], other_columns[name], equal_nan=True) for name in columns)
    summary["file"] = other_summary["file"]
    assert summary == other_summary


def test_recording_in_degrees_with_epoch_times_gives_the_same_estimate(recording, estimate):
    columns = first_rows(recording, 200)
    expected, _ = estimate(columns)
    for name in ("heading", "rudder"):
        columns[f"{name}_deg"] = np.degrees(columns.pop(f"{name}_rad"))
    columns["time_s"] = columns["time_s"] + 1.7e9
    text = text_of(columns | {"time_s": [repr(time_s) for time_s in columns["time_s"].tolist()]})
    result, summary = estimate(text)
    assert result["time_s"].tolist() == columns["time_s"].tolist()
    assert np.max(np.abs(difference_deg(result["heading_rad"], expected["heading_rad"]))) < 1e-3
    assert summary["from_s"] == 1.7e9


@pytest.mark.parametrize(
    "names",
    [
        ("time_s", "heading_rad"),
        ("time_s", "heading_rad", "rudder_rad"),
        pytest.param(("time_s", "heading_rad", "lat_deg", "lon_deg"), marks=pytest.mark.proof),
        pytest.param(("time_s", "heading_rad", "sog_m_s", "cog_deg"), marks=pytest.mark.proof),
    ],
)
def test_estimate_without_optional_columns(recording, estimate, names):
    result, summary = estimate({name: recording.columns[name] for name in names})
    is_late = result["time_s"] > 200.0
    assert np.sqrt(np.mean(difference_deg(result["heading_rad"], recording.hull_rad)[is_late] ** 2)) < MAX_RMS_DEG
    assert summary["rudder_recorded"] == ("rudder_rad" in names)
    if "rudder_rad" not in names:
        assert np.isnan(result["heading_in_10_s_rad"]).all()
        assert summary["rudder_travel_recorded_deg_per_h"] is None
    if "lat_deg" not in names and "sog_m_s" not in names:
        assert summary["positions"] == 0


def test_gap_in_the_headings_is_a_fault_and_has_no_rows(recording, estimate):
    time_s = recording.columns["time_s"]
    rows = (time_s < 200.0) | (time_s > 260.0)
    result, summary = estimate({name: values[rows] for name, values in recording.columns.items()})
    assert result["time_s"].size == np.count_nonzero(rows)
    losses = [fault for fault in summary["faults"] if fault["name"] == "COMPASS_SILENT"]
    assert len(losses) == 1
    assert 200.0 < losses[0]["from_s"] < 205.0
    assert 260.0 < losses[0]["to_s"] < 263.0


def test_empty_cells_are_ignored(recording, estimate):
    columns = first_rows(recording, 300)
    columns["heading_rad"][100:110] = np.nan
    for name, every in (("rudder_rad", 2), ("lat_deg", 5), ("lon_deg", 5), ("sog_m_s", 5), ("cog_deg", 5)):
        columns[name][np.arange(300) % every != 0] = np.nan
    result, summary = estimate(columns)
    assert result["time_s"].size == 290
    assert summary["positions"] == 60
    assert np.isfinite(result["heading_rad"]).all()


def test_recording_with_a_high_rate_is_estimated(estimate):
    fast_recording = sea(seconds=40.0, rate_hz=20.0)
    result, summary = estimate(fast_recording.columns)
    assert (result["time_s"].size, summary["rate_hz"]) == (800, 20.0)
    assert np.sqrt(np.mean(difference_deg(result["heading_rad"], fast_recording.hull_rad)[400:] ** 2)) < MAX_RMS_DEG


def test_recorded_goal_is_the_commanded_heading(recording, estimate):
    short_recording = first_rows(recording, 200)
    _, without_goal = estimate(short_recording)
    _, with_goal = estimate({**short_recording, "goal_rad": np.full(200, 1.0)})
    assert with_goal["rudder_travel_commanded_deg_per_h"] != without_goal["rudder_travel_commanded_deg_per_h"]


def test_notes_name_the_source_of_the_speed(recording, estimate):
    columns = {name: recording.columns[name][:200] for name in ("time_s", "heading_rad")}
    speed = np.full(200, 0.62)
    _, water_summary = estimate({**columns, "speed_m_s": speed}, "--ship", "K=0.049,T=4")
    assert water_summary["ship"]["speed"] == pytest.approx(0.62)
    assert any("mean speed through the water, 0.62 m/s" in note for note in water_summary["notes"])
    _, ground_summary = estimate({**columns, "sog_m_s": speed}, "--ship", "K=0.049,T=4,speed=0.4")
    assert ground_summary["ship"]["speed"] == pytest.approx(0.4)
    assert any(note.startswith("initial speed: mean speed over ground") for note in ground_summary["notes"])


def test_parameters_are_read_from_parameter_and_vehicle_files(recording, estimate, tmp_path):
    params, vehicle = tmp_path / "boat.parm", tmp_path / "boat.toml"
    params.write_text("MDL_K 0.1\nFS_RUD_ACT 1\n")
    device = 'driver = "{}"\nport = "x"\nbaud = 38400\n'
    vehicle.write_text(
        f"[compass]\n{device.format('nmea')}[rudder]\n{device.format('volz')}id = 1\n[parameters]\nMDL_T_S = 7.0\n"
    )
    short_recording = first_rows(recording, 200)
    _, summary = estimate(short_recording, "--params", str(params), "--vehicle", str(vehicle))
    assert summary["ship"] == {"K": 0.1, "T": 7.0, "alpha": 17.0, "speed": 0.4}


def test_onboard_log_is_estimated(estimate):
    result, summary = estimate((LOGS / "tank.BIN").read_bytes())
    assert result["time_s"].size == summary["headings"] == 600
    assert summary["rudder_recorded"]
    assert summary["positions"] == 59
    assert summary["faults"] == []


def test_goals_of_an_onboard_log_have_the_times_of_their_ticks():
    recording = log_file.read(LOGS / "tank.BIN")
    assert recording.goal_s[[0, -1]] == pytest.approx([0.0, 59.9], abs=0.05)
    assert recording.goal_rad[-1] == pytest.approx(math.radians(60.0))


def test_compass_failure_in_an_onboard_log_is_a_fault(estimate):
    _, summary = estimate((LOGS / "second_compass.BIN").read_bytes())
    assert [fault["name"] for fault in summary["faults"]] == ["COMPASS_SILENT"]


def test_ardupilot_log_is_estimated(recording, estimate):
    columns = recording.columns
    rate = np.gradient(recording.hull_rad, columns["time_s"])
    fixes = np.stack([columns[name] for name in ("lat_deg", "lon_deg", "cog_deg", "sog_m_s")], axis=1)
    log = log_bytes(
        *(columns[name] for name in ("time_s", "rudder_rad", "heading_rad")), rate, pulses=True, fixes=fixes
    )
    result, summary = estimate(log)
    assert result["time_s"][0] == 5.0
    is_late = result["time_s"] > 200.0
    assert np.sqrt(np.mean(difference_deg(result["heading_rad"], recording.hull_rad)[is_late] ** 2)) < MAX_RMS_DEG
    assert summary["positions"] == 800
    assert summary["recorded_speed_over_ground_m_s"] == pytest.approx(np.mean(columns["sog_m_s"]), rel=1e-3)


def test_json_is_written_to_standard_output(recording, tmp_path, capsys):
    path = tmp_path / "table.csv"
    path.write_text(text_of(first_rows(recording, 100)))
    assert main(["estimate", str(path), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["headings"] == 100


def test_page_is_self_contained(recording, estimate, tmp_path):
    path = tmp_path / "page.html"
    short_recording = first_rows(recording, 300)
    _, summary = estimate(short_recording, "--page", str(path))
    text = path.read_text()
    assert "http" not in text.replace("http-equiv", "").replace("http://www.w3.org/", "")
    block = text.split('<script type="application/json" class="voyage">')[1].split("</script>")[0]
    voyage = json.loads(block)
    assert voyage["columns"]["time_s"] == recording.columns["time_s"][:300].tolist()
    plotted = {line["column"] for panel in voyage["panels"] for line in panel["lines"]}
    assert plotted <= voyage["columns"].keys()
    assert voyage["spectrum"]["marks"]
    assert f"{summary['heading']['rms_error_deg']:.3g}" in text


def test_long_recording_is_thinned_on_the_page(estimate, tmp_path, monkeypatch):
    monkeypatch.setattr(page, "MAX_ROWS", 100)
    path = tmp_path / "page.html"
    estimate(sea(seconds=150.0).columns, "--page", str(path))
    voyage = json.loads(path.read_text().split('class="voyage">')[1].split("</script>")[0])
    assert len(voyage["columns"]["time_s"]) == 100


VALUES = {"time_s": np.arange(50) * 0.5, "heading_rad": np.linspace(0.1, 0.2, 50)}
CELLS = {name: [f"{value:.4f}" for value in values] for name, values in VALUES.items()}


def with_cell(name, row, text):
    return {**CELLS, name: [*CELLS[name][:row], text, *CELLS[name][row + 1 :]]}


@pytest.mark.parametrize(
    ("columns", "error_text"),
    [
        ({"time_s": CELLS["time_s"]}, ":1: missing column heading_rad; name the columns time_s,"),
        ({"heading_rad": CELLS["heading_rad"]}, ":1: missing column time_s"),
        (with_cell("heading_rad", 3, "north"), ":5: heading_rad 'north' is not a finite number; remove the row"),
        (with_cell("heading_rad", 3, "inf"), ":5: heading_rad 'inf' is not a finite number"),
        (with_cell("time_s", 30, "2.0"), ":32: time_s 2 is not later than 14.5; sort the rows by time"),
        (with_cell("time_s", 30, "soon"), ":32: time_s 'soon' is not a time"),
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
def test_invalid_table_is_refused(tmp_path, capsys, columns, error_text):
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
def test_invalid_option_is_refused(tmp_path, monkeypatch, capsys, arguments, error_text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "table.csv").write_text(text_of(CELLS))
    assert main(["estimate", "table.csv", *arguments]) == 2
    assert error_text in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"", b"no log at all" * 100])
def test_log_without_headings_is_refused(tmp_path, capsys, content):
    path = tmp_path / "x.BIN"
    path.write_bytes(content)
    assert main(["estimate", str(path)]) == 2
    assert f"{path}: contains 0 headings" in capsys.readouterr().err


def test_missing_file_is_refused(tmp_path, capsys):
    assert main(["estimate", str(tmp_path / "x.BIN")]) == 2
    assert main(["estimate", str(tmp_path / "x.csv")]) == 2
    assert capsys.readouterr().err.count("No such file") == 2


def test_angles_of_a_rudder_angle_sensor_replace_those_of_the_shaft(tmp_path):
    """The log of a run, with a sensor that shows another angle than the shaft."""
    rewritten = tmp_path / "sensor.BIN"
    data = [header(schema.TYPES, 0)]
    for number, tick in enumerate(LogReader(LOGS / "tank.BIN")):
        inputs = replace(tick.inputs, rudder_angles=(RudderAngleSample(tick.inputs.tick.t_s, 0.3),))
        batch = schema.TICK.pack(inputs.tick.t_s, inputs.tick) + schema.encode_inputs(inputs)
        batch += schema.CONTROL.pack(inputs.tick.t_s, Output(tick.command, SNAPSHOT))
        data.append(schema.append_end(batch, inputs.tick.t_s, number))
    rewritten.write_bytes(b"".join(data))
    recording = log_file.read(rewritten)
    assert not recording.is_shaft
    assert {sample.shaft_rad for sample in recording.rudder} == {0.3}
    assert "angles of the rudder angle sensor used" in recording.notes
    assert log_file.read(LOGS / "tank.BIN").is_shaft
