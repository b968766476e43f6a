"""What the script says of small checkouts whose rooms are known."""

import subprocess
import sys

import pytest

from support.paths import ROOT

HOUSE = ROOT / ".ci" / "house.py"
SOUND = {
    "firmware_py/__init__.py": "",
    "firmware_py/common/angles.py": "",
    "firmware_py/model/kt.py": "from firmware_py.common.angles import wrap\n",
    "firmware_py/control/deep/law.py": "def law():\n    from firmware_py.model import kt\n",
    "firmware_py/link/wire.py": "import firmware_py.common.angles\n",
    "firmware_py/loop.py": "from firmware_py import control, link\nfrom .model import kt\n",
    "hil/sim/world.py": "from firmware_py.model import kt\n",
    "tests/test_loop.py": "",
}


@pytest.fixture
def house(tmp_path):
    """Build a checkout of these files over the sound ones and run the script on it."""

    def run(*options, files=()):
        for name, content in (SOUND | dict(files)).items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)
        return subprocess.run(
            [sys.executable, HOUSE, tmp_path, *options], capture_output=True, text=True, check=False, timeout=60
        )

    return run


def cells(result):
    """The numbers of the table: row -> the firmware's, the harness's, the tests'."""
    rows = [line.strip("| ").split(" | ") for line in result.stdout.splitlines() if line.startswith("| ")]
    return {row[0]: row[1:] for row in rows[1:]}


def test_a_sound_house_passes_the_check_in_silence(house):
    result = house("--check")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


def test_rooms_arrows_and_floors_are_counted(house):
    found = cells(house())
    # loop imports control, link and model; model and link import common, control imports model.
    assert found["rooms"] == ["5", "1", "-"]
    assert found["files at the top, beside folders"] == ["2", "0", "-"]
    assert found["arrows between rooms"] == ["6", "0", "-"]
    assert found["floors"] == ["4", "1", "-"]
    assert found["circles"] == ["0", "0", "-"]
    assert found["arrows against the flow"] == ["0", "0", "-"]


@pytest.mark.parametrize(
    ("name", "content", "finding"),
    [
        ("firmware_py/common/up.py", "from firmware_py.model import kt\n", "against the flow: common -> model"),
        (
            "firmware_py/common/up.py",
            "from firmware_py.model import kt\n",
            "a circle of imports: common - model",
        ),
        ("firmware_py/log/peer.py", "import firmware_py.link.wire\n", "against the flow: log -> link"),
        ("firmware_py/safety/peer.py", "from ..control import law\n", "against the flow: safety -> control"),
        ("firmware_py/core/edge.py", "from firmware_py import link\n", "against the flow: core -> link"),
        ("firmware_py/attic/box.py", "", "the flow has no place for the room attic"),
        ("firmware_py/model/long.py", "\n" * 301, "firmware_py/model/long.py (301)"),
        ("hil/long.py", "def sail():\n" + "    pass\n" * 60, "hil/long.py:sail (61)"),
    ],
)
def test_what_is_too_much_is_named_and_refused(house, name, content, finding):
    result = house("--check", files={name: content})
    assert result.returncode == 1
    assert finding in result.stdout


def test_nine_files_beside_the_folders_are_too_many(house):
    names = ("devices", "vehicle", "modes", "assemble", "cli", "__main__")
    eight = {f"firmware_py/{name}.py": "" for name in names}
    assert house("--check", files=eight).returncode == 0
    result = house("--check", files={"firmware_py/core.py": ""})
    assert (result.returncode, "9 files beside folders" in result.stdout) == (1, True)


def test_a_folder_that_is_no_checkout_is_refused(tmp_path):
    result = subprocess.run([sys.executable, HOUSE, tmp_path], capture_output=True, text=True, check=False, timeout=60)
    assert result.returncode == 2
    assert "name a checkout" in result.stderr
