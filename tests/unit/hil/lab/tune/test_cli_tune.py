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


def refused(capsys, *words: str) -> str:
    assert main(["tune", *words]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    return output.err


@pytest.mark.parametrize(
    ("words", "error"),
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
def test_a_usage_error_is_one_line_with_a_remedy(capsys, words, error):
    assert error in refused(capsys, *words)


def test_a_read_only_file_is_refused_before_the_search(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("os.access", lambda _path, _mode: False)
    assert "no permission to write" in refused(capsys, "--json", str(tmp_path / "tune.json"))


def test_a_write_error_is_one_line():
    with pytest.raises(HilError, match="--json /dev/full cannot be written: No space left"):
        outputs.write("--json", Path("/dev/full"), "text")


@pytest.fixture(autouse=True)
def _quiet(monkeypatch):
    """ProgressReport nothing now and then, however slow the machine is."""
    monkeypatch.setattr(progress, "PIPE_INTERVAL_S", math.inf)


NAMES = {"--json": "tune.json", "--plot": "tune.png", "--out-params": "tune.param"}


def tuned(tmp_path, *words: str):
    """Tune the test boat and return the JSON and the parameters that were written."""
    vehicle = tmp_path / "boat.toml"
    vehicle.write_text(VEHICLE)
    files = [word for option, name in NAMES.items() for word in (option, str(tmp_path / name))]
    assert main(["tune", *files, "--vehicle", str(vehicle), *words]) == 0
    page = (tmp_path / "tune.html").read_text()
    assert "data:image/png;base64," in page
    assert "://" not in page
    assert (tmp_path / "tune.png").read_bytes().startswith(b"\x89PNG")
    written = (tmp_path / "tune.param").read_text()
    return json.loads((tmp_path / "tune.json").read_text()), parse_file(written, "tune.param"), written


@pytest.mark.timeout(600)
def test_the_default_controller_is_tuned_and_all_files_are_written(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(delivered, "SEEDS", 1)
    monkeypatch.setattr(delivered, "FRESH_SEEDS", 1)
    words = ["--scenarios", "sea+leeway=8", "--evaluations", "20", "--seed", "3", "--price", "4"]
    found, kept, written = tuned(tmp_path, *words)
    output = capsys.readouterr()
    assert output.err == ""
    assert "defaults: CTL_PRICE 1, RUD_DBAND_DEG" in output.out
    assert "seas: sea+leeway=8; ships K T alpha x 1 1 1, 0.7 1.3 1.3, 1.3 0.7 0.7; seeds 3" in output.out
    assert "case, seed 1000006 " in output.out
    assert "largest mean deg" in output.out
    assert "on two other ships the tuner found nothing better" in output.out
    assert "compare --prices 0.5 1 2 4" in output.out
    assert "# Seas: sea+leeway=8;" in written
    # The file does not switch the tuned controller off.
    assert (kept.pop("CTL_MODE"), kept.pop("EST_MODE")) == (1.0, 1.0)
    assert kept == {name: pytest.approx(value) for name, value in found["chosen"]["parameters"].items()}
    assert set(kept) == {"CTL_PRICE", "RUD_DBAND_DEG"}
    assert (found["vehicle"], found["controller"]) == ("Test boat", "delivered")
    assert (found["seeds"], found["fresh_seeds"]) == ([3], [1_000_006])
    assert len(found["cases"]) == 3
    assert 8 <= found["evaluations"] == len(found["tried"]) <= 24
    # With this price the rudder travel is smaller, also in fresh seas.
    delivered_there, chosen_there = found["fresh_seas"]["delivered"], found["fresh_seas"]["chosen"]
    assert not found["chosen"]["kept_as_delivered"]
    assert kept["CTL_PRICE"] > 1.0
    assert chosen_there["travel"] < delivered_there["travel"] == 1.0


@pytest.mark.proof
def test_fixed_gains_are_tuned_and_switch_the_default_controller_off(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(search, "PRICES", (1.0,))
    found, kept, written = tuned(tmp_path, "--fixed-gains", "--scenarios", "tank,sea", "--evaluations", "150")
    output = capsys.readouterr()
    assert output.err == ""
    assert "ITAE of a 30 deg step" in output.out
    for text in (output.out, written):
        assert "switches the default controller off (CTL_MODE 0, EST_MODE 0)" in text
    assert (kept.pop("CTL_MODE"), kept.pop("EST_MODE")) == (0.0, 0.0)
    assert kept == {name: pytest.approx(value) for name, value in found["chosen"]["parameters"].items()}
    assert set(kept) >= {"CTL_K1", "CTL_K2"}
    assert found["vehicle"] == "Test boat"
    assert len(found["cases"]) == 12
    assert found["evaluations"] >= 50
    assert found["front"][0]["travel_deg_per_h"] < found["front"][-1]["travel_deg_per_h"]
    lost = {row["scenario"]: row for row in found["switched_off"]}
    assert set(lost) == {"tank", "sea"}
    travel = [lost["sea"][name]["rudder_travel_deg_per_h"] for name in ("delivered", "chosen")]
    assert travel[1] > 2.0 * travel[0]
