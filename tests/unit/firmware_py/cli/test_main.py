"""The command line: exit codes, one-line errors, help."""

import io
import json
import os
import pty
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py.__main__ import COMMANDS, main
from firmware_py.cli.errors import print_error
from firmware_py.cli.run import default_state_directory
from firmware_py.common.parameter_table import TABLE
from firmware_py.system.serial_port import SerialPort
from hil.__main__ import main as hil_main
from support.paths import REPLAY, ROOT

VEHICLE = """
[compass]
driver = "nmea"
port = "{compass}"
baud = 4800
[rudder]
driver = "volz"
port = "{rudder}"
baud = 115200
"""


@pytest.fixture
def vehicle(tmp_path):
    """Write a vehicle file with these ports; return its path as a string."""

    def write(compass="/dev/none-a", rudder="/dev/none-b", more="", old="", new=""):
        path = tmp_path / "boat.toml"
        path.write_text((VEHICLE.format(compass=compass, rudder=rudder) + more).replace(old, new))
        return str(path)

    return write


@pytest.fixture
def ports():
    """Two serial ports: ptys."""
    pairs = [pty.openpty() for _ in range(2)]
    yield [os.ttyname(slave) for _, slave in pairs]
    for descriptor in (end for pair in pairs for end in pair):
        os.close(descriptor)


def one_line_error(capsys, arguments, code=2):
    assert main(arguments) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    return line


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command, capsys):
    with pytest.raises(SystemExit) as exit_info:
        main([command, "-h"])
    assert exit_info.value.code == 0
    assert COMMANDS[command][1][1:] in capsys.readouterr().out.replace("\n", " ")


@pytest.mark.parametrize("arguments", [[], ["sink"], ["run"], ["run", "a", "--bogus"], ["decode", "nmea"]])
def test_usage_error_is_one_line_with_remedy(arguments, capsys):
    assert "-h" in one_line_error(capsys, arguments)


def test_error_without_a_text_still_names_the_command(capsys):
    assert (print_error("run", ""), print_error("run", "a\nb", 3)) == (2, 3)
    assert capsys.readouterr().err == "rambler run: \nrambler run: a\nrambler run: b\n"


def test_run_refuses_a_wrong_vehicle_file_port_or_link(capsys, tmp_path, vehicle, ports):
    def error(path, *words):
        return one_line_error(capsys, ["run", path, "--state", str(tmp_path / "state"), *words])

    assert "no such vehicle file" in error(str(tmp_path / "none.toml"))
    assert "unknown parameter 'CTL_K9'" in error(vehicle(more="[parameters]\nCTL_K9 = 1\n"))
    options = 'baud = 4800\nsentences = ["HDX"]'
    assert "[compass]" in error(vehicle(*ports, old="baud = 4800", new=options))
    assert "no such port" in error(vehicle())
    assert "udpout" in error(vehicle(*ports), "--link", "pigeon:1")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other_socket:
        other_socket.bind(("127.0.0.1", 0))
        assert "in use" in error(vehicle(*ports), "--link", f"udpin:127.0.0.1:{other_socket.getsockname()[1]}")
    other_port = SerialPort(ports[1], 115200)
    other_port.open()
    try:
        assert "in use" in error(vehicle(*ports))
    finally:
        other_port.close()


def test_params_prints_the_table_and_checks_files(capsys, tmp_path):
    assert main(["params"]) == 0
    table = capsys.readouterr().out
    assert all(row.name in table and row.text in table for row in TABLE)
    file = tmp_path / "boat.param"
    file.write_text("CTL_K1 41\n")
    assert main(["params", str(file)]) == 0
    assert "CTL_K1           40 -> 41" in capsys.readouterr().out
    file.write_text("CTL_K1 1e300\n")
    assert "boat.param:1" in one_line_error(capsys, ["params", str(file)], code=1)


def test_parameter_metadata_has_every_parameter(capsys):
    assert main(["params", "--metadata"]) == 0
    assert [row["name"] for row in json.loads(capsys.readouterr().out)["parameters"]] == [row.name for row in TABLE]


def test_check_prints_each_finding_and_fails_for_silent_devices(capsys, vehicle, ports, tmp_path, monkeypatch):
    monkeypatch.setattr("firmware_py.cli.check.LISTEN_TIME_S", 0.2)
    assert main(["check", vehicle(*ports), "--state", str(tmp_path / "state")]) == 1
    text = capsys.readouterr().out
    levels = {subject: level for level, subject, *_ in map(str.split, text.splitlines())}
    assert levels["compass"] == levels["rudder"] == "FAIL"
    assert levels["storage"] == levels["clock"] == levels["parameters"] == "PASS"
    assert "silent; check power, wiring and baud rate" in text


def test_listen_and_check_report_missing_ports_and_a_second_compass(capsys, vehicle, monkeypatch, tmp_path):
    monkeypatch.setattr("firmware_py.cli.check.LISTEN_TIME_S", 0.2)
    path = vehicle(more='[compass_b]\ndriver = "pni_tcm"\nport = "/dev/none-c"\nbaud = 38400\n')
    assert main(["listen", path, "--seconds", "1.05", "--json"]) == 1
    records = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(record["device"], record["state"]) for record in records] == [
        (name, "absent") for name in ("compass", "rudder", "compass_b")
    ]
    assert "no such port" in records[0]["error"]
    assert records[2]["driver"] == "pni_tcm"
    assert "--seconds" in one_line_error(capsys, ["listen", path, "--seconds", "-1"])
    assert main(["check", path, "--state", str(tmp_path / "state")]) == 1
    assert "FAIL  compass_b" in capsys.readouterr().out


def run_in_shell(command):
    """Return the exit code and standard error of a shell command."""
    process = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False)
    return process.returncode, process.stderr


def test_example_on_a_full_disk_leaves_no_file(tmp_path):
    path = tmp_path / "boat.toml"
    result = run_in_shell(f"ulimit -f 0; exec {sys.executable} -m firmware_py example {path}")
    assert result == (2, f"rambler: {path}: File too large; use another path\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", ["firmware_py plan items", "hil scenarios"])
def test_closed_standard_streams_become_dev_null(words):
    assert run_in_shell(f"exec {sys.executable} -m {words} <&- >&-") == (0, "")


@pytest.mark.parametrize(("errors", "later"), [("strict", "backslashreplace"), ("replace", "replace")])
def test_error_handler_that_the_user_has_set_for_a_stream_is_kept(errors, later, monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), "ascii", errors)
    monkeypatch.setattr(sys, "stdout", stream)
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    assert main(["nothing"]) == 2
    assert stream.errors == later
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"


def test_ctypes_is_not_imported_before_the_standard_streams_are_checked():
    """libffi opens a file with ctypes, which would become a closed standard input."""
    code = "import sys, firmware_py.__main__; sys.exit('ctypes' in sys.modules)"
    assert run_in_shell(f'exec {sys.executable} -c "{code}"') == (0, "")


@pytest.mark.parametrize(("program", "word"), [(main, "replay"), (hil_main, "report")])
def test_unprintable_path_is_escaped(program, word, monkeypatch):
    output = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors="strict")
    monkeypatch.setattr(sys, "stderr", output)
    assert program([word, "/nowhere/B\u00f8t"]) == 2
    output.seek(0)
    assert "/nowhere/B\\xf8t" in output.read()


@pytest.mark.parametrize(
    "words", [("run", "tank", "--goal", "0:0", "--out"), ("board",), ("report", "--out", "page.html")]
)
def test_name_that_is_not_utf_8_is_a_one_line_error(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    name = os.fsdecode(b"B\xf8t")
    if words[0] == "report":
        (tmp_path / name).write_bytes((REPLAY / "tank_pni_volz.BIN").read_bytes())
    assert hil_main([*words, name]) == 2
    output = capsys.readouterr()
    assert (output.out, output.err.count("\n")) == ("", 1)
    assert "not representable in this locale; use another name, or LC_ALL=C.UTF-8\n" in output.err
    assert not [path for path in tmp_path.iterdir() if path.is_dir()]


def test_relative_state_home_is_reported_and_ignored(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(Path, "home", lambda: tmp_path / "home")
    default = tmp_path / "home/.local/state/rambler/boat-1"
    text = "rambler: XDG_STATE_HOME=some/where is not absolute and is ignored; give an absolute path, or --state\n"
    cases = (("some/where", default, text), (str(tmp_path), tmp_path / "rambler/boat-1", ""), ("", default, ""))
    for value, directory, error in cases:
        monkeypatch.setenv("XDG_STATE_HOME", value)
        assert default_state_directory("Boat 1") == directory
        assert capsys.readouterr().err == error


@pytest.mark.parametrize("words", [("run",), ("check",), ("calibrate", "rudder")])
def test_user_without_home_directory_needs_state(words, vehicle, monkeypatch, capsys):
    def raise_error():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", raise_error)
    text = "no home directory for the state; give a directory with --state"
    assert text in one_line_error(capsys, [*words, vehicle()])
