"""`rambler-hil tune`: errors, report and files."""

import json
import math
from pathlib import Path

import pytest

from firmware_py.common.parameters import parse_file
from hil.__main__ import main
from hil.cli import outputs, progress
from hil.errors import HilError
from hil.lab.tune import delivered, search

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


def refusal(capsys, *arguments: str) -> str:
    assert main(["tune", *arguments]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    return output.err


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--scenarios", "pond"], "unknown scenario 'pond'"),
        (["--scenarios", ","], "name at least one"),
        (["--price", "-1"], "--price -1.0: give a number from 0"),
        (["--price", "nan"], "give a number"),
        (["--evaluations", "5"], "give a number from 20"),
        (["--fixed-gains", "--evaluations", "20"], "give a number from 150"),
        (["--only-gains"], "add --fixed-gains"),
        (["--scenarios", "swell+kite=1"], "unknown option 'kite'"),
        (["--with", "supply"], "trial runs do not simulate power"),
        (["--with", "leeway=80"], "must be -45 to 45 deg"),
        (["--fixed-gains", "--with", "leeway=8"], "remove one of them"),
        (["--fixed-gains", "--scenarios", "ocean-1"], "has disturbances that the trial runs do not have"),
        (["--seed", "-3"], "--seed -3"),
        (["--plot", "picture.gif"], "must end in .png or .html"),
        (["--json", "nowhere/at/all.json"], "create it first"),
        (["--json", "/"], "is a directory"),
        (["--out-params", "."], "is a directory"),
        (["--vehicle", "no-such.toml"], "no such vehicle file"),
        (["--law", "--vehicle", "boat.toml"], "--vehicle: not used with --law"),
        (["--law", "--fixed-gains"], "--fixed-gains: not used with --law"),
        (["--law", "--scenarios", "pond"], "unknown scenario 'pond'"),
    ],
)
def test_usage_error_is_one_line_with_a_remedy(capsys, arguments, error):
    assert error in refusal(capsys, *arguments)


def test_read_only_file_is_refused_before_the_search(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("os.access", lambda _path, _mode: False)
    assert "no permission to write" in refusal(capsys, "--json", str(tmp_path / "tune.json"))


def test_write_error_is_one_line():
    with pytest.raises(HilError, match="--json /dev/full cannot be written: No space left"):
        outputs.write("--json", Path("/dev/full"), "text")


@pytest.fixture(autouse=True)
def _no_progress_lines(monkeypatch):
    """Suppress progress lines, also on a slow machine."""
    monkeypatch.setattr(progress, "PIPE_INTERVAL_S", math.inf)


OUTPUT_NAMES = {"--json": "tune.json", "--plot": "tune.png", "--out-params": "tune.param"}


def run_tune(tmp_path, *arguments: str):
    """Tune the test boat; return the JSON, the parameters and the text of the parameter file."""
    vehicle = tmp_path / "boat.toml"
    vehicle.write_text(VEHICLE)
    files = [word for option, name in OUTPUT_NAMES.items() for word in (option, str(tmp_path / name))]
    assert main(["tune", *files, "--vehicle", str(vehicle), *arguments]) == 0
    page = (tmp_path / "tune.html").read_text()
    assert "data:image/png;base64," in page
    assert "://" not in page
    assert (tmp_path / "tune.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "tune.param").read_text()
    return json.loads((tmp_path / "tune.json").read_text()), parse_file(text, "tune.param"), text


@pytest.mark.timeout(600)
def test_default_controller_is_tuned_and_all_files_are_written(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(delivered, "SEEDS", 1)
    monkeypatch.setattr(delivered, "FRESH_SEEDS", 1)
    arguments = ["--scenarios", "sea+leeway=8", "--evaluations", "20", "--seed", "3", "--price", "4"]
    data, parameters, text = run_tune(tmp_path, *arguments)
    output = capsys.readouterr()
    assert output.err == ""
    assert "defaults: CTL_PRICE 1, RUD_DBAND_DEG" in output.out
    assert "seas: sea+leeway=8; ships K T alpha x 1 1 1, 0.7 1.3 1.3, 1.3 0.7 0.7; seeds 3" in output.out
    assert "case, seed 1000006 " in output.out
    assert "largest mean deg" in output.out
    assert "on two other ships the tuner found nothing better" in output.out
    assert "compare --prices 0.5 1 2 4" in output.out
    assert "# Seas: sea+leeway=8;" in text
    # The file does not switch the tuned controller off.
    assert (parameters.pop("CTL_MODE"), parameters.pop("EST_MODE")) == (1.0, 1.0)
    assert parameters == {name: pytest.approx(value) for name, value in data["chosen"]["parameters"].items()}
    assert set(parameters) == {"CTL_PRICE", "RUD_DBAND_DEG"}
    assert (data["vehicle"], data["controller"]) == ("Test boat", "delivered")
    assert (data["seeds"], data["fresh_seeds"]) == ([3], [1_000_006])
    assert len(data["cases"]) == 3
    assert 8 <= data["evaluations"] == len(data["tried"]) <= 24
    # A price of 4 reduces the rudder travel, also in fresh seas.
    default_scores, chosen_scores = data["fresh_seas"]["delivered"], data["fresh_seas"]["chosen"]
    assert not data["chosen"]["kept_as_delivered"]
    assert parameters["CTL_PRICE"] > 1.0
    assert chosen_scores["travel"] < default_scores["travel"] == 1.0


@pytest.mark.proof
def test_fixed_gains_are_tuned_and_switch_the_default_controller_off(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(search, "PRICES", (1.0,))
    data, parameters, text = run_tune(tmp_path, "--fixed-gains", "--scenarios", "tank,sea", "--evaluations", "150")
    output = capsys.readouterr()
    assert output.err == ""
    assert "ITAE of a 30 deg step" in output.out
    for printed in (output.out, text):
        assert "switches the default controller off (CTL_MODE 0, EST_MODE 0)" in printed
    assert (parameters.pop("CTL_MODE"), parameters.pop("EST_MODE")) == (0.0, 0.0)
    assert parameters == {name: pytest.approx(value) for name, value in data["chosen"]["parameters"].items()}
    assert set(parameters) >= {"CTL_K1", "CTL_K2"}
    assert data["vehicle"] == "Test boat"
    assert len(data["cases"]) == 12
    assert data["evaluations"] >= 50
    assert data["front"][0]["travel_deg_per_h"] < data["front"][-1]["travel_deg_per_h"]
    switched_off = {row["scenario"]: row for row in data["switched_off"]}
    assert set(switched_off) == {"tank", "sea"}
    travel = [switched_off["sea"][name]["rudder_travel_deg_per_h"] for name in ("delivered", "chosen")]
    assert travel[1] > 2.0 * travel[0]
