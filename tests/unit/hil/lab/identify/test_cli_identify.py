import gzip
import json
import re

import numpy as np
import pytest

from firmware_py.common.parameters import parse_file
from hil.__main__ import main

HEADER = "time_s,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s"
ROWS = [f"{0.1 * n:.1f},{0.3 if n % 40 < 20 else -0.3},{0.001 * n},0.01,0.4" for n in range(100)]


def with_row(number: int, text: str) -> str:
    """Return a good file but for one row; row 0 stands in line 2."""
    rows = list(ROWS)
    rows[number] = text
    return "\n".join([HEADER, *rows]) + "\n"


def plain(rows: list[str], header: str = HEADER) -> str:
    return "\n".join([header, *rows]) + "\n"


BAD = {
    "no time column": (
        plain([row.split(",", 1)[1] for row in ROWS], HEADER.split(",", 1)[1]),
        ":1: missing column time_s",
    ),
    "no rudder column": (plain(ROWS, HEADER.replace("rudder_rad", "helm")), ":1: missing column rudder_rad; name"),
    "a column twice": (plain(ROWS, HEADER.replace("speed_m_s", "time_s")), ":1: column time_s occurs twice"),
    "infinite": (with_row(5, "0.5,0.3,inf,0.01,0.4"), ":7: heading_rad 'inf' is not a finite number"),
    "huge": (with_row(5, "0.5,0.3,1e300,0.01,0.4"), ":7: heading_rad 1e300 is beyond 1e+06; give radians"),
    "word": (with_row(5, "0.5,hard over,0,0.01,0.4"), ":7: rudder_rad 'hard over' is not a finite number"),
    "mostly holes": (
        plain([row if n < 10 else row.replace(f",{0.001 * n},0.01", ",,") for n, row in enumerate(ROWS)]),
        ": only 10 rows have a heading or yaw rate with a rudder near it; fill the empty cells",
    ),
    "two logs": (plain(ROWS) + plain(ROWS), ":102: the column names are repeated; split the file"),
    "NMEA": ("$IIHDT,12.5,T*00\n" * 50, "NMEA 0183 sentences instead of a table"),
    "damaged packing": (gzip.compress(plain(ROWS).encode())[:-40], "its gzip data is damaged"),
    "time goes back": (with_row(50, "0.35,0.3,0,0.01,0.4"), ":52: time_s 0.35 is not later than 4.9; sort the rows"),
    "degrees": (
        with_row(5, "0.5,20,0,0.01,0.4"),
        ":7: rudder_rad 20 is beyond 90 deg (1.5708 rad); for degrees use",
    ),
    "degrees a second": (
        with_row(5, "0.5,0.3,0,45,0.4"),
        ":7: yaw_rate_rad_s 45 is beyond 30; give radians per second",
    ),
    "cut": (with_row(50, "5.0,0.3,0"), ":52: 3 fields for 5 column names; correct or remove the line"),
    "constant rudder": (plain([row.replace("-0.3", "0.3") for row in ROWS]), "constant rudder 0.3: no information"),
    "nothing turns": (plain([f"{n},{n % 7 / 10},1,0," for n in range(100)]), "heading and yaw rate are constant"),
    "too short": (plain(ROWS[:12]), "too short, 12 rows; the file covers 0 to 1.1 s; give at least 20 rows"),
    "header alone": (HEADER + "\n", "no rows below the column names"),
    "empty": ("", "empty; the first line must name the columns"),
    "neither heading nor yaw rate": (plain([f"{n},{n % 3 / 10},,,1" for n in range(50)]), "are both empty; fill one"),
    "binary": (bytes(range(256)) * 40, "not text; give a table (CSV), or an onboard log whose name ends in .BIN"),
    "not UTF-8": (plain(ROWS).encode() + b"\xff\xfe", "not text"),
    "zeros": (b"\0" * 4096, ""),
}


def refused(capsys, *words):
    assert main(["identify", *map(str, words)]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    return output.err


@pytest.mark.parametrize("name", BAD)
def test_errors_of_a_file(capsys, tmp_path, name):
    content, texts = BAD[name]
    path = tmp_path / "bad.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    output = refused(capsys, path)
    assert f"{path}{texts}" in output if texts.startswith(":") else (str(path) in output and texts in output)


@pytest.mark.parametrize(
    ("words", "texts"),
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
def test_usage_errors(capsys, tmp_path, words, texts):
    good = tmp_path / "good.csv"
    good.write_text(plain(ROWS))
    assert texts in refused(capsys, *(word.format(good=good, folder=tmp_path) for word in words))


def test_a_garbled_onboard_log_is_refused(capsys, tmp_path):
    path = tmp_path / "x.BIN"
    path.write_bytes(bytes(range(256)) * 8)
    assert str(path) in refused(capsys, path)


def write(path, recording, speed="0.4"):
    columns = (recording.time_s, recording.rudder_rad, recording.heading_rad, recording.yaw_rate_rad_s)
    lines = [f"{t:.2f},{d:.6f},{h:.6f},{r:.6f},{speed}" for t, d, h, r in zip(*columns, strict=True)]
    path.write_text(plain(lines))


@pytest.fixture(scope="module")
def tank(yard, tmp_path_factory):
    """A folder with a zigzag and circles of the paper's boat."""
    folder = tmp_path_factory.mktemp("tank")
    boat, time = yard.boat(0.049, 4.0, 17.0, 0.02), np.arange(4000) * 0.1
    for seed, (name, angle, leg) in enumerate((("zigzag", 0.3, 20.0), ("circles", 0.6, 80.0))):
        rudder = yard.steps(time, angle, leg, 0.5)
        motion = boat.motion(time, rudder)
        write(folder / f"{name}.csv", yard.recorded(time, rudder, *motion, seed=seed, noise=0.05, rate_noise=0.01))
    return folder


def test_the_whole_contract(tank, tmp_path, capsys):
    names = {option: tmp_path / f"out.{option}" for option in ("json", "png", "html", "param")}
    words = [tank / "zigzag.csv", f"{tank}/circles.csv:0:250", "--validate", f"{tank}/circles.csv:250:"]
    words += ["--json", names["json"], "--plot", names["png"], "--out-params", names["param"]]
    assert main(["identify", *map(str, words)]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    for texts in ("verdict", "95 % interval", "disturbances: ", "prediction of"):
        assert texts in output.out
    data = json.loads(names["json"].read_text())
    assert data["model"] == "cubic"
    for name, true in (("K", 0.049), ("T", 4.0), ("alpha", 17.0), ("delta0", 0.02)):
        assert set(data[name]) >= {"value", "se", "verdict", "interval"}
        assert data[name]["verdict"] == "identifiable"
        assert abs(data[name]["value"] - true) < 4.0 * data[name]["se"]
        low, high = data[name]["interval"]
        assert low <= data[name]["value"] <= high
    assert data["train"]["yaw_rate_rmse_rad_s"] == pytest.approx(np.radians(0.01), rel=0.05)
    (held_out,) = data["validate"]
    assert held_out["file"].endswith("circles.csv:250:")
    assert held_out["yaw_rate_rmse_rad_s"] == pytest.approx(np.radians(0.01), rel=0.05)
    assert held_out["heading_rmse_rad"] < np.radians(0.5)
    assert data["evaluations"] > 1000
    assert data["seconds"] > 0.0
    assert names["png"].read_bytes().startswith(b"\x89PNG")
    values = dict(parse_file(names["param"].read_text(), "x"))
    assert values["MDL_K"] == pytest.approx(0.049, rel=0.01)
    assert values["MDL_T_S"] == pytest.approx(4.0, rel=0.01)
    assert values["MDL_SPEED"] == pytest.approx(0.4)
    assert values["CTL_TRIM_DEG"] == pytest.approx(np.degrees(0.02), abs=0.1)


def test_a_linear_model_holds_alpha_at_zero(tank, tmp_path):
    out, found = tmp_path / "boat.param", tmp_path / "found.json"
    words = [f"{tank}/zigzag.csv:0:150", "--model", "linear", "--out-params", str(out), "--json", str(found)]
    assert main(["identify", *words]) == 0
    data = json.loads(found.read_text())
    assert (data["model"], data["alpha"]["value"], data["alpha"]["interval"]) == ("linear", 0.0, [0.0, 0.0])
    assert dict(parse_file(out.read_text(), "x"))["MDL_ALPHA_S2"] == 0.0


@pytest.mark.parametrize("name", ["flight.tlog", "flight.TLOG"])
def test_a_telemetry_log_is_named(capsys, tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"\0" * 64)
    assert "MAVLink telemetry log; give the onboard .BIN log, or convert it" in refused(capsys, path)


def test_a_page_stands_alone_and_a_seed_gives_the_same_result(tank, tmp_path, capsys):
    page, first, second = tmp_path / "p.html", tmp_path / "1.json", tmp_path / "2.json"
    source = f"{tank}/zigzag.csv:0:150"
    assert main(["identify", source, "--plot", str(page), "--json", str(first), "--seed", "3"]) == 0
    assert main(["identify", source, "--json", str(second), "--seed", "3"]) == 0
    text = page.read_text()
    assert "data:image/png;base64," in text
    assert "://" not in text  # "http" alone comes up by chance in a picture
    results = [json.loads(path.read_text()) for path in (first, second)]
    for one in results:
        del one["seconds"]
    assert results[0] == results[1]
    capsys.readouterr()


def test_a_log_without_rudder_effect_returns_1(yard, tmp_path, capsys):
    time = np.arange(2000) * 0.1
    rudder = yard.steps(time, 0.3, 20.0, 0.5)
    still = np.zeros(time.size)
    write(tmp_path / "noise.csv", yard.recorded(time, rudder, still, still))
    out = tmp_path / "x.param"
    assert main(["identify", str(tmp_path / "noise.csv"), "--out-params", str(out)]) == 1
    output = capsys.readouterr()
    assert "no effect of the rudder" in output.err
    assert "zigzag" in output.out
    assert not out.exists()


def test_a_thruster_command_is_taken_and_gives_no_parameters(yard, tmp_path, capsys):
    boat, time = yard.boat(0.0012, 1.5), np.arange(1500) * 0.1
    command = yard.steps(time, 500.0, 6.0, 1e9)
    write(tmp_path / "t.csv", yard.recorded(time, command, *boat.motion(time, command, held=True)), speed="")
    source = str(tmp_path / "t.csv")
    assert "--rudder-unit any" in refused(capsys, source)
    assert main(["identify", source, "--rudder-unit", "any", "--json", "-"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert abs(data["K"]["value"] - 0.0012) < 4.0 * data["K"]["se"]
    assert main(["identify", source, "--rudder-unit", "any", "--out-params", str(tmp_path / "x")]) == 2


def test_a_thruster_command_has_no_unit(yard, monkeypatch, tmp_path):
    from hil.lab.identify import page  # noqa: PLC0415 - with matplotlib: no time of each collection
    from hil.report.style import new_figure  # noqa: PLC0415

    boat, time = yard.boat(0.0012, 1.5), np.arange(1000) * 0.1
    command = yard.steps(time, 500.0, 6.0, 1e9)
    write(tmp_path / "t.csv", yard.recorded(time, command, *boat.motion(time, command, held=True)), speed="")
    figures = []
    monkeypatch.setattr(page, "new_figure", lambda *words: figures.append(new_figure(*words)) or figures[0])
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
