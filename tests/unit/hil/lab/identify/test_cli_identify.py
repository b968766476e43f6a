"""`rambler-hil identify`: errors, reports, files and exit codes."""

import gzip
import json
import re

import numpy as np
import pytest

from firmware_py.common.parameters import parse_file
from firmware_py.link.nmea import sentence
from hil.__main__ import main

HEADER = "time_s,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s"
ROWS = [f"{0.1 * n:.1f},{0.3 if n % 40 < 20 else -0.3},{0.001 * n},0.01,0.4" for n in range(100)]


def with_row(number: int, text: str) -> str:
    """Return a valid file with one row replaced; row 0 is in line 2."""
    rows = list(ROWS)
    rows[number] = text
    return "\n".join([HEADER, *rows]) + "\n"


def csv_text(rows: list[str], header: str = HEADER) -> str:
    return "\n".join([header, *rows]) + "\n"


INVALID_FILES = {
    "no time column": (
        csv_text([row.split(",", 1)[1] for row in ROWS], HEADER.split(",", 1)[1]),
        ":1: missing column time_s",
    ),
    "no rudder column": (csv_text(ROWS, HEADER.replace("rudder_rad", "wheel")), ":1: missing column rudder_rad; name"),
    "a column twice": (csv_text(ROWS, HEADER.replace("speed_m_s", "time_s")), ":1: column time_s occurs twice"),
    "infinite": (with_row(5, "0.5,0.3,inf,0.01,0.4"), ":7: heading_rad 'inf' is not a finite number"),
    "huge": (with_row(5, "0.5,0.3,1e300,0.01,0.4"), ":7: heading_rad 1e300 is beyond 1e+06; give radians"),
    "text": (with_row(5, "0.5,hard over,0,0.01,0.4"), ":7: rudder_rad 'hard over' is not a finite number"),
    "mostly empty cells": (
        csv_text([row if n < 10 else row.replace(f",{0.001 * n},0.01", ",,") for n, row in enumerate(ROWS)]),
        ": only 10 rows have a heading or yaw rate with a rudder near it; fill the empty cells",
    ),
    "two logs": (csv_text(ROWS) + csv_text(ROWS), ":102: the column names are repeated; split the file"),
    "NMEA with one time": (
        (sentence("II", "HDT", ["12.5", "T"]) + sentence("GP", "ZDA", ["120000", "27", "11", "2026", "00", "00"])) * 50,
        "NMEA 0183 with too few different times (1 of at least 2); also record RMC, GGA, GLL or ZDA",
    ),
    "NMEA": ("$IIHDT,12.5,T*00\n" * 50, "NMEA 0183 sentences instead of a table"),
    "damaged gzip": (gzip.compress(csv_text(ROWS).encode())[:-40], "its gzip data is damaged"),
    "decreasing time": (with_row(50, "0.35,0.3,0,0.01,0.4"), ":52: time_s 0.35 is not later than 4.9; sort the rows"),
    "degrees": (with_row(5, "0.5,20,0,0.01,0.4"), ":7: rudder_rad 20 is beyond 90 deg (1.5708 rad); for degrees use"),
    "degrees per second": (
        with_row(5, "0.5,0.3,0,45,0.4"),
        ":7: yaw_rate_rad_s 45 is beyond 30; give radians per second",
    ),
    "truncated row": (with_row(50, "5.0,0.3,0"), ":52: 3 fields for 5 column names; correct or remove the line"),
    "constant rudder": (csv_text([row.replace("-0.3", "0.3") for row in ROWS]), "constant rudder 0.3: no information"),
    "constant heading": (csv_text([f"{n},{n % 7 / 10},1,0," for n in range(100)]), "heading and yaw rate are constant"),
    "too short": (csv_text(ROWS[:12]), "too short, 12 rows; the file covers 0 to 1.1 s; give at least 20 rows"),
    "only a header": (HEADER + "\n", "no rows below the column names"),
    "empty": ("", "empty; the first line must name the columns"),
    "neither heading nor yaw rate": (
        csv_text([f"{n},{n % 3 / 10},,,1" for n in range(50)]),
        "are both empty; fill one",
    ),
    "binary": (bytes(range(256)) * 40, "not text; give a table (CSV), or an onboard log whose name ends in .BIN"),
    "not UTF-8": (csv_text(ROWS).encode() + b"\xff\xfe", "not text"),
    "zeros": (b"\0" * 4096, ""),
}


def refusal(capsys, *words):
    assert main(["identify", *map(str, words)]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    return output.err


@pytest.mark.parametrize("name", INVALID_FILES)
def test_invalid_file_is_refused(capsys, tmp_path, name):
    content, error = INVALID_FILES[name]
    path = tmp_path / "bad.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    output = refusal(capsys, path)
    assert f"{path}{error}" in output if error.startswith(":") else (str(path) in output and error in output)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["{good}:500:600"], "too short, 0 rows; the file covers 0 to 9.9 s"),
        (["{good}:5:1"], "empty range from 5 to 1 s"),
        (["{good}:one:2"], "'one' is not a number of seconds"),
        (["{folder}"], "give a table (CSV)"),
        (["{folder}/none.csv"], "No such file"),
        (["{folder}/none.BIN"], "none.BIN"),
        (["{good}", "--validate", "{folder}/none.csv"], "No such file"),
        (["{good}", "--plot", "picture.gif"], "ends in .png or .html"),
        (["{good}", "--json", "{folder}"], "is a directory; name a file in it"),
        (["{good}", "--plot", "{folder}/none/x.png"], "does not exist"),
        (["{good}", "--out-params", "{folder}/none/x.param"], "create it first"),
        (["{good}", "--seed", "-1"], "give a whole number from 0"),
        (["{good}", "--model", "quartic"], "invalid choice"),
        ([], "required"),
    ],
)
def test_invalid_arguments_are_refused(capsys, tmp_path, arguments, error):
    good = tmp_path / "good.csv"
    good.write_text(csv_text(ROWS))
    assert error in refusal(capsys, *(argument.format(good=good, folder=tmp_path) for argument in arguments))


@pytest.mark.parametrize(
    ("name", "content", "error"),
    [
        ("x.BIN", bytes(range(256)) * 8, "x.BIN"),
        ("flight.tlog", b"\0" * 64, "MAVLink telemetry log; give the onboard .BIN log, or convert it"),
        ("flight.TLOG", b"\0" * 64, "MAVLink telemetry log; give the onboard .BIN log, or convert it"),
    ],
)
def test_unreadable_log_is_refused(capsys, tmp_path, name, content, error):
    path = tmp_path / name
    path.write_bytes(content)
    assert error in refusal(capsys, path)


def write_csv(path, recording, speed="0.4"):
    columns = (recording.time_s, recording.rudder_rad, recording.heading_rad, recording.yaw_rate_rad_s)
    lines = [f"{t:.2f},{d:.6f},{h:.6f},{r:.6f},{speed}" for t, d, h, r in zip(*columns, strict=True)]
    path.write_text(csv_text(lines))


@pytest.fixture(scope="module")
def recordings(simulation, tmp_path_factory):
    """Return a folder with a zigzag and circles of the boat of the paper."""
    folder = tmp_path_factory.mktemp("tank")
    boat, time = simulation.boat(0.049, 4.0, 17.0, 0.02), np.arange(4000) * 0.1
    for seed, (name, angle, leg) in enumerate((("zigzag", 0.3, 20.0), ("circles", 0.6, 80.0))):
        rudder = simulation.steps(time, angle, leg, 0.5)
        motion = boat.motion(time, rudder)
        write_csv(
            folder / f"{name}.csv", simulation.recorded(time, rudder, *motion, seed=seed, noise=0.05, rate_noise=0.01)
        )
    return folder


def test_identification_writes_report_json_plot_and_parameters(recordings, tmp_path, capsys):
    files = {option: tmp_path / f"out.{option}" for option in ("json", "png", "html", "param")}
    words = [
        recordings / "zigzag.csv",
        f"{recordings}/circles.csv:0:250",
        "--validate",
        f"{recordings}/circles.csv:250:",
    ]
    words += ["--json", files["json"], "--plot", files["png"], "--out-params", files["param"]]
    assert main(["identify", *map(str, words)]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    for text in ("verdict", "95 % interval", "disturbances: ", "prediction of"):
        assert text in output.out
    data = json.loads(files["json"].read_text())
    assert data["model"] == "cubic"
    for name, true in (("K", 0.049), ("T", 4.0), ("alpha", 17.0), ("delta0", 0.02)):
        assert set(data[name]) >= {"value", "se", "verdict", "interval"}
        assert data[name]["verdict"] == "identifiable"
        assert abs(data[name]["value"] - true) < 4.0 * data[name]["se"]
        low, high = data[name]["interval"]
        assert low <= data[name]["value"] <= high
    assert data["train"]["yaw_rate_rmse_rad_s"] == pytest.approx(np.radians(0.01), rel=0.05)
    (validation,) = data["validate"]
    assert validation["file"].endswith("circles.csv:250:")
    assert validation["yaw_rate_rmse_rad_s"] == pytest.approx(np.radians(0.01), rel=0.05)
    assert validation["heading_rmse_rad"] < np.radians(0.5)
    assert data["evaluations"] > 1000
    assert data["seconds"] > 0.0
    assert files["png"].read_bytes().startswith(b"\x89PNG")
    values = dict(parse_file(files["param"].read_text(), "x"))
    assert values["MDL_K"] == pytest.approx(0.049, rel=0.01)
    assert values["MDL_T_S"] == pytest.approx(4.0, rel=0.01)
    assert values["MDL_SPEED"] == pytest.approx(0.4)
    assert values["CTL_TRIM_DEG"] == pytest.approx(np.degrees(0.02), abs=0.1)


def test_linear_model_fixes_alpha_at_zero(recordings, tmp_path):
    out, result = tmp_path / "boat.param", tmp_path / "result.json"
    words = [f"{recordings}/zigzag.csv:0:150", "--model", "linear", "--out-params", str(out), "--json", str(result)]
    assert main(["identify", *words]) == 0
    data = json.loads(result.read_text())
    assert (data["model"], data["alpha"]["value"], data["alpha"]["interval"]) == ("linear", 0.0, [0.0, 0.0])
    assert dict(parse_file(out.read_text(), "x"))["MDL_ALPHA_S2"] == 0.0


def test_page_is_self_contained_and_the_same_seed_gives_the_same_result(recordings, tmp_path, capsys):
    page, first, second = tmp_path / "p.html", tmp_path / "1.json", tmp_path / "2.json"
    source = f"{recordings}/zigzag.csv:0:150"
    assert main(["identify", source, "--plot", str(page), "--json", str(first), "--seed", "3"]) == 0
    assert main(["identify", source, "--json", str(second), "--seed", "3"]) == 0
    text = page.read_text()
    assert "data:image/png;base64," in text
    assert "://" not in text  # "http" may occur by chance in the encoded image
    results = [json.loads(path.read_text()) for path in (first, second)]
    for result in results:
        del result["seconds"]
    assert results[0] == results[1]
    capsys.readouterr()


def test_log_without_rudder_effect_returns_1(simulation, tmp_path, capsys):
    time = np.arange(2000) * 0.1
    rudder = simulation.steps(time, 0.3, 20.0, 0.5)
    constant = np.zeros(time.size)
    write_csv(tmp_path / "noise.csv", simulation.recorded(time, rudder, constant, constant))
    out = tmp_path / "x.param"
    assert main(["identify", str(tmp_path / "noise.csv"), "--out-params", str(out)]) == 1
    output = capsys.readouterr()
    assert "no effect of the rudder" in output.err
    assert "zigzag" in output.out
    assert not out.exists()


def test_thruster_command_gives_a_model_but_no_parameter_file(simulation, tmp_path, capsys):
    boat, time = simulation.boat(0.0012, 1.5), np.arange(1500) * 0.1
    command = simulation.steps(time, 500.0, 6.0, 1e9)
    write_csv(
        tmp_path / "t.csv", simulation.recorded(time, command, *boat.motion(time, command, is_stepwise=True)), speed=""
    )
    source = str(tmp_path / "t.csv")
    assert "--rudder-unit any" in refusal(capsys, source)
    assert main(["identify", source, "--rudder-unit", "any", "--json", "-"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert abs(data["K"]["value"] - 0.0012) < 4.0 * data["K"]["se"]
    assert main(["identify", source, "--rudder-unit", "any", "--out-params", str(tmp_path / "x")]) == 2


def test_page_of_a_thruster_command_names_no_unit(simulation, monkeypatch, tmp_path):
    from hil.lab.identify import page  # noqa: PLC0415 - matplotlib is slow to import
    from hil.report.style import new_figure  # noqa: PLC0415

    boat, time = simulation.boat(0.0012, 1.5), np.arange(1000) * 0.1
    command = simulation.steps(time, 500.0, 6.0, 1e9)
    write_csv(
        tmp_path / "t.csv", simulation.recorded(time, command, *boat.motion(time, command, is_stepwise=True)), speed=""
    )
    figures = []
    monkeypatch.setattr(page, "new_figure", lambda *arguments: figures.append(new_figure(*arguments)) or figures[0])
    out = tmp_path / "page.html"
    assert main(["identify", str(tmp_path / "t.csv"), "--rudder-unit", "any", "--plot", str(out)]) == 0
    panel = figures[0].axes[3]
    assert panel.get_ylabel() == "command"
    assert figures[0].axes[0].get_title(loc="left") == "t.csv"
    assert np.max(np.abs(panel.lines[0].get_ydata())) == 500.0
    table = out.read_text(encoding="utf-8").partition("<table>")[2].partition("</table>")[0]
    assert "1/s" not in table
    assert "rad" not in table
    assert "deg" not in re.sub(r'<span class="note">.*?</span>', "", table)
