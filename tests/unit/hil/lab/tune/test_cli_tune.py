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
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--scenarios", "pond"], "unknown scenario 'pond'"),
        (["--scenarios", ","], "name at least one"),
        (["--price", "-1"], "--price -1.0: give a number from 0"),
        (["--price", "nan"], "give a number"),
        (["--evaluations", "5"], "give a number from 20"),
        (["--fixed-gains", "--evaluations", "20"], "give a number from 150"),
        (["--only-gains"], "give --fixed-gains beside it"),
        (["--scenarios", "swell+kite=1"], "unknown option 'kite'"),
        (["--with", "supply"], "the trial runs know no power"),
        (["--with", "leeway=80"], "must be -45 to 45 deg"),
        (["--fixed-gains", "--with", "leeway=8"], "leave one of them out"),
        (["--fixed-gains", "--scenarios", "ocean-1"], "has what the tuner's model leaves out"),
        (["--seed", "-3"], "--seed -3"),
        (["--plot", "picture.gif"], "must end in .png or .html"),
        (["--json", "nowhere/at/all.json"], "make it first"),
        (["--json", "/"], "is a directory"),
        (["--out-params", "."], "is a directory"),
        (["--vehicle", "no-such.toml"], "no such vehicle file"),
        (["--law", "--vehicle", "boat.toml"], "--vehicle: the law is the same for every vehicle"),
        (["--law", "--fixed-gains"], "leave it or --law out"),
        (["--law", "--scenarios", "pond"], "unknown scenario 'pond'"),
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


@pytest.fixture(autouse=True)
def _quiet(monkeypatch):
    """Tell nothing now and then, however slow the machine is."""
    monkeypatch.setattr(progress, "NOW_AND_THEN_S", math.inf)


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
def test_the_delivered_controller_is_tuned_and_everything_is_written(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(delivered, "SEEDS", 1)
    monkeypatch.setattr(delivered, "FRESH_SEEDS", 1)
    words = ["--scenarios", "sea+leeway=8", "--evaluations", "20", "--seed", "3", "--price", "4"]
    found, kept, written = tuned(tmp_path, *words)
    said = capsys.readouterr()
    assert said.err == ""
    assert "delivered defaults: CTL_PRICE 1, RUD_DBAND_DEG" in said.out
    assert "seas: sea+leeway=8; ships K T alpha x 1 1 1, 0.7 1.3 1.3, 1.3 0.7 0.7; seeds 3" in said.out
    assert "case, seed 1000006 " in said.out
    assert "worst mean deg" in said.out
    assert "what tuning is worth: on two other ships it found nothing better" in said.out
    assert "compare --prices 0.5 1 2 4" in said.out
    assert "# Seas: sea+leeway=8;" in written
    # The file does not switch off what was tuned.
    assert (kept.pop("CTL_MODE"), kept.pop("EST_MODE")) == (1.0, 1.0)
    assert kept == {name: pytest.approx(value) for name, value in found["chosen"]["parameters"].items()}
    assert set(kept) == {"CTL_PRICE", "RUD_DBAND_DEG"}
    assert (found["vehicle"], found["controller"]) == ("Test boat", "delivered")
    assert (found["seeds"], found["fresh_seeds"]) == ([3], [1_000_006])
    assert len(found["cases"]) == 3
    assert 8 <= found["evaluations"] == len(found["tried"]) <= 24
    # At such a price of the rudder she is to be quieter, in seas of other seeds, too.
    delivered_there, chosen_there = found["fresh_seas"]["delivered"], found["fresh_seas"]["chosen"]
    assert not found["chosen"]["kept_as_delivered"]
    assert kept["CTL_PRICE"] > 1.0
    assert chosen_there["travel"] < delivered_there["travel"] == 1.0


@pytest.mark.proof
def test_fixed_gains_are_tuned_and_say_that_they_switch_the_delivered_controller_off(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(search, "PRICES", (1.0,))
    found, kept, written = tuned(tmp_path, "--fixed-gains", "--scenarios", "tank,sea", "--evaluations", "150")
    said = capsys.readouterr()
    assert said.err == ""
    assert "ITAE of a 30 deg step" in said.out
    for told in (said.out, written):
        assert "switches the delivered controller off (CTL_MODE 0, EST_MODE 0)" in told
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
