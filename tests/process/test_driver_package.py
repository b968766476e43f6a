"""The driver package of docs/how-to/driver-package.md, built, installed by pip, and run by the real programs."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from support.paths import ROOT

SOURCE = ROOT / "docs/how-to/os5000"
VEHICLE = """
[compass]
driver = "os5000"
port = "{folder}/no-port"
baud = 19200
[rudder]
driver = "volz"
port = "{folder}/no-port-either"
baud = 115200
"""


def run(site, *command, code=0):
    """Run a command with the installed package; return its output."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])}
    process = subprocess.run(
        [sys.executable, *map(str, command)], capture_output=True, text=True, env=environment, check=False, cwd=site
    )
    assert process.returncode == code, process.stdout + process.stderr
    return process.stdout + process.stderr


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Build and install the package as the page does, into a folder of its own."""
    folder = tmp_path_factory.mktemp("site")
    source = shutil.copytree(SOURCE, folder / "source")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*command, "--target", str(folder), str(source)], check=True)
    return folder


@pytest.fixture
def vehicle(tmp_path):
    path = tmp_path / "boat.toml"
    path.write_text(VEHICLE.format(folder=tmp_path))
    return path


def findings(site, vehicle, code=1):
    """Return the findings of `rambler check` about drivers and compass; the ports are missing, so it fails."""
    output = run(site, "-m", "firmware_py", "check", vehicle, "--state", vehicle.parent / "state", "--json", code=code)
    return {
        finding["subject"]: (finding["level"], finding["text"])
        for finding in json.loads(output.splitlines()[-1])["findings"]
    }


def test_tests_of_the_package_pass(site):
    run(site, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", os.devnull, site / "source/test_rambler_os5000.py")


def test_installed_driver_steers_the_simulated_boat(site, tmp_path):
    out = tmp_path / "run"
    run(
        site, "-m", "hil", "run", "tank", "--compass", "os5000", "--speed", "max", "--seconds", "60",
        "--goal", "0:0,10:40", "--out", out,
    )  # fmt: skip
    (_, goal) = json.loads((out / "summary.json").read_text())["goals"]
    assert abs(goal["mean_error_deg"]) < 3.0
    assert goal["rms_error_deg"] < 20.0


def test_check_names_the_package_and_decode_reads_nothing(site, vehicle, tmp_path):
    assert findings(site, vehicle)["drivers"] == (
        "pass",
        "[compass]: os5000 of the installed package rambler-os5000 1.0",
    )
    capture = tmp_path / "capture.bin"
    capture.write_bytes(b"$C320.5P0.2R-18.3T19.0*3C\r\n")
    output = run(site, "-m", "firmware_py", "decode", "os5000", capture, code=2)
    assert "the package of this driver defines no capture format: 'os5000'" in output  # the package defines none


def test_vehicle_file_is_checked_with_the_options_of_the_package(site, vehicle):
    vehicle.write_text(vehicle.read_text().replace("baud = 19200", "baud = 19200\nroll_sign = 2"))
    output = run(site, "-m", "firmware_py", "check", vehicle, code=2)
    assert "[compass] roll_sign: 2 is out of range; allowed: -1 to 1" in output


def test_driver_of_no_installed_package_is_an_error(vehicle, tmp_path):
    output = run(tmp_path, "-m", "firmware_py", "check", vehicle, code=2)
    assert "driver 'os5000' is not known; use one of nmea, pni_tcm, mti" in output


BREAKS = {
    "interface": (
        lambda text: text.replace("interface=1", "interface=2"),
        (
            "package rambler-os5000 1.0 is for interface version 2, this program has version 1; "
            "install another version of the package"
        ),
    ),
    "import": (
        lambda text: "import no_such_module\n" + text.replace("from __future__ import annotations\n", ""),
        (
            "package rambler-os5000 1.0: rambler_os5000:DRIVER: ModuleNotFoundError: No module named 'no_such_module'; "
            "correct or remove it"
        ),
    ),
    "class": (
        lambda text: text.replace("DRIVER: Driver[Compass] = Driver(", "DRIVER = dict("),
        "package rambler-os5000 1.0: rambler_os5000:DRIVER is not a Driver; update it",
    ),
}


@pytest.mark.parametrize("kind", BREAKS)
def test_boat_starts_without_the_device_of_a_broken_package(site, vehicle, tmp_path, kind):
    change, reason = BREAKS[kind]
    broken = shutil.copytree(site, tmp_path / "site", ignore=shutil.ignore_patterns("source", "__pycache__"))
    file = broken / "rambler_os5000.py"
    file.write_text(change(file.read_text()))
    if kind == "interface":
        assert findings(broken, vehicle)["drivers"] == ("fail", f"[compass]: {reason}")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(broken), str(ROOT)])}
    command = [sys.executable, "-m", "firmware_py", "run", str(vehicle), "--state", str(tmp_path / "state"), "--wait"]
    lines = []
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
    ) as boat:
        while "Mode HOLD" not in (line := boat.stdout.readline()) and line:
            lines.append(line)
        boat.terminate()
        boat.stdout.read()
        assert boat.wait() == 0
    assert reason in "".join(lines)


def test_exception_of_a_driver_is_reported_with_its_place_and_the_boat_continues(site, tmp_path):
    broken = shutil.copytree(site, tmp_path / "site", ignore=shutil.ignore_patterns("source", "__pycache__"))
    file = broken / "rambler_os5000.py"
    file.write_text(file.read_text().replace('values.get("P")', 'values["Q"]'))
    out = tmp_path / "run"
    words = ["run", "tank", "--compass", "os5000", "--speed", "max", "--seconds", "20", "--mode", "hold"]
    assert "see " in run(broken, "-m", "hil", *words, "--out", out, code=1)
    log = (out / "firmware.log").read_text()
    assert "Compass: driver of package rambler-os5000 1.0: KeyError: 'Q' (rambler_os5000.py:" in log
    assert log.count("KeyError") == 1
    assert "SIGTERM: autopilot ends" in log
