import json
from pathlib import Path

import pytest

from firmware_py.common.parameters import parse_file
from hil.__main__ import main
from hil.cli import outputs
from hil.errors import HilError
from hil.lab.tune import search

VEHICLE = """
[vehicle]
name = "Test boat"
[compass]
driver = "nmea"
port = "/dev/x"
baud = 38400
[rudder]
driver = "dynamixel"
port = "/dev/y"
baud = 57600
[parameters]
MDL_K = 0.06
MDL_T_S = 5
CTL_K1 = 30
"""


def refused(capsys, *words: str) -> str:
    assert main(["tune", *words]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--scenarios", "pond"], "no scenario 'pond'"),
        (["--scenarios", ","], "name at least one"),
        (["--price", "-1"], "--price -1.0: give a number from 0"),
        (["--price", "nan"], "give a number"),
        (["--evaluations", "5"], "give a number from 150"),
        (["--seed", "-3"], "--seed -3"),
        (["--plot", "picture.gif"], "must end in .png or .html"),
        (["--json", "nowhere/at/all.json"], "make it first"),
        (["--json", "/"], "is a directory"),
        (["--out-params", "."], "is a directory"),
        (["--vehicle", "no-such.toml"], "no such vehicle file"),
    ],
)
def test_bad_usage_is_one_line_with_a_remedy(capsys, words, told):
    assert told in refused(capsys, *words)


def test_a_file_that_may_not_be_written_is_refused_before_the_work(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("os.access", lambda _path, _mode: False)
    assert "may not be written" in refused(capsys, "--json", str(tmp_path / "tune.json"))


def test_a_file_that_cannot_be_written_after_all_is_one_error():
    with pytest.raises(HilError, match="--json /dev/full cannot be written: No space left"):
        outputs.write("--json", Path("/dev/full"), "text")


def test_a_vehicle_is_tuned_and_everything_is_written(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(search, "PRICES", (1.0,))
    vehicle = tmp_path / "boat.toml"
    vehicle.write_text(VEHICLE)
    names = {"--json": "tune.json", "--plot": "tune.png", "--out-params": "tune.param"}
    words = [word for option, name in names.items() for word in (option, str(tmp_path / name))]
    words += ["--vehicle", str(vehicle), "--scenarios", "tank,sea", "--evaluations", "150"]
    assert main(["tune", *words]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert "ITAE of a 30 deg step" in said.out
    found = json.loads((tmp_path / "tune.json").read_text())
    kept = parse_file((tmp_path / "tune.param").read_text(), "tune.param")
    # They belong to the controller with fixed gains, so the file chooses it.
    assert (kept.pop("CTL_MODE"), kept.pop("EST_MODE")) == (0.0, 0.0)
    assert kept == {name: pytest.approx(value) for name, value in found["chosen"]["parameters"].items()}
    assert set(kept) >= {"CTL_K1", "CTL_K2"}
    assert found["vehicle"] == "Test boat"
    assert len(found["cases"]) == 12
    assert found["evaluations"] >= 50
    assert found["front"][0]["travel_deg_per_h"] < found["front"][-1]["travel_deg_per_h"]
    assert (tmp_path / "tune.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "tune.html").read_text()
    assert "data:image/png;base64," in page
    assert "://" not in page
