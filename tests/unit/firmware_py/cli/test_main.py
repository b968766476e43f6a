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
from firmware_py.cli.run import default_state_directory
from firmware_py.common.parameter_table import TABLE
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
    """Write a vehicle file with the given ports."""

    def write(compass="/dev/none-a", rudder="/dev/none-b", more=""):
        path = tmp_path / "boat.toml"
        path.write_text(VEHICLE.format(compass=compass, rudder=rudder) + more)
        return str(path)

    return write


@pytest.fixture
def ports():
    """Two serial ports: ptys."""
    ends = [pty.openpty() for _ in range(2)]
    yield [os.ttyname(slave) for _, slave in ends]
    for pair in ends:
        for end in pair:
            os.close(end)


def one_line_error(capsys, arguments, code=2):
    assert main(arguments) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert len(lines) == 1, captured.err
    return lines[0]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "-h"])
    assert ended.value.code == 0
    assert COMMANDS[command][1][1:] in capsys.readouterr().out.replace("\n", " ")


@pytest.mark.parametrize("arguments", [[], ["sink"], ["run"], ["run", "a", "--bogus"], ["decode", "morse", "x"]])
def test_usage_error_is_one_line_with_remedy(arguments, capsys):
    assert "-h" in one_line_error(capsys, arguments)


def test_run_refuses_a_wrong_vehicle_file(capsys, tmp_path, vehicle):
    assert "no such vehicle file" in one_line_error(capsys, ["run", str(tmp_path / "none.toml")])
    path = vehicle(more="[parameters]\nCTL_K9 = 1\n")
    assert "unknown parameter 'CTL_K9'" in one_line_error(capsys, ["run", path])


def test_run_refuses_wrong_driver_options(capsys, vehicle, ports, tmp_path):
    path = vehicle(*ports)
    text = (tmp_path / "boat.toml").read_text().replace("baud = 4800", 'baud = 4800\nsentences = ["HDX"]')
    (tmp_path / "boat.toml").write_text(text)
    assert "[compass]" in one_line_error(capsys, ["run", path, "--state", str(tmp_path / "state")])


def test_run_refuses_a_missing_port_and_one_in_use(capsys, vehicle, ports, tmp_path):
    state = ["--state", str(tmp_path / "state")]
    assert "no such port" in one_line_error(capsys, ["run", vehicle(), *state])
    from firmware_py.system.serial_port import SerialPort  # noqa: PLC0415 - the one that has it first

    other = SerialPort(ports[1], 115200)
    other.open()
    try:
        assert "in use" in one_line_error(capsys, ["run", vehicle(*ports), *state])
    finally:
        other.close()


def test_run_refuses_a_wrong_link_and_one_in_use(capsys, vehicle, ports, tmp_path):
    state = ["--state", str(tmp_path / "state")]
    assert "udpout" in one_line_error(capsys, ["run", vehicle(*ports), *state, "--link", "pigeon:1"])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        assert "in use" in one_line_error(capsys, ["run", vehicle(*ports), *state, "--link", url])


def test_params_prints_the_table_and_checks_files(capsys, tmp_path):
    assert main(["params"]) == 0
    printed = capsys.readouterr().out
    assert all(row.name in printed and row.text in printed for row in TABLE)
    file = tmp_path / "boat.param"
    file.write_text("CTL_K1 41\n")
    assert main(["params", str(file)]) == 0
    assert "CTL_K1           40 -> 41" in capsys.readouterr().out
    file.write_text("CTL_K1 1e300\n")
    assert "boat.param:1" in one_line_error(capsys, ["params", str(file)], code=1)


def test_generated_pages_are_up_to_date(capsys):
    pages = {"--markdown": "REFERENCE", "--faults": "FAULTS", "--messages": "MESSAGES", "--texts": "TEXTS"}
    for option, name in pages.items():
        assert main(["params", option]) == 0
        assert capsys.readouterr().out == (ROOT / f"params/{name}.md").read_text(), "write them with make pages"
    assert main(["params", "--metadata"]) == 0
    assert [row["name"] for row in json.loads(capsys.readouterr().out)["parameters"]] == [row.name for row in TABLE]


def test_decode_prints_json_lines(capsys, tmp_path):
    file = tmp_path / "capture.nmea"
    file.write_text("$HEHDT,341.8,T*21\r\n$HEHDT,341.8,T*22\r\n")
    assert main(["decode", "nmea", str(file), "--json"]) == 0
    first, second = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert (first["line"], first["type"], first["heading_true_deg"]) == (1, "heading", 341.8)
    assert (second["line"], second["type"], second["error"]) == (2, "error", "checksum")
    assert "cannot be read" in one_line_error(capsys, ["decode", "nmea", str(tmp_path / "none")])
    file.write_text("a wrong file\n")
    assert one_line_error(capsys, ["decode", "nmea", str(file)], 0).endswith(
        f"{file}: no nmea message in 13 bytes; check KIND"
    )


def test_check_prints_each_finding_and_fails_for_silent_devices(capsys, vehicle, ports, tmp_path, monkeypatch):
    monkeypatch.setattr("firmware_py.cli.check.LISTEN_S", 0.2)
    assert main(["check", vehicle(*ports), "--state", str(tmp_path / "state")]) == 1
    lines = capsys.readouterr().out.splitlines()
    found = {line.split()[1]: line.split()[0] for line in lines}
    assert found["compass"] == found["rudder"] == "FAIL"
    assert found["storage"] == found["clock"] == found["parameters"] == "PASS"
    assert any("silent; check power, wiring and baud rate" in line for line in lines)


def test_listen_and_check_include_a_second_compass(capsys, vehicle, monkeypatch, tmp_path):
    monkeypatch.setattr("firmware_py.cli.check.LISTEN_S", 0.2)
    path = vehicle(more='[compass_b]\ndriver = "pni_tcm"\nport = "/dev/none-c"\nbaud = 38400\n')
    assert main(["listen", path, "--seconds", "1.05", "--json"]) == 1
    assert '"device": "compass_b", "driver": "pni_tcm"' in capsys.readouterr().out
    assert main(["check", path, "--state", str(tmp_path / "state")]) == 1
    assert "FAIL  compass_b" in capsys.readouterr().out


def test_listen_reports_missing_ports(capsys, vehicle):
    assert main(["listen", vehicle(), "--seconds", "1.05", "--json"]) == 1
    records = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {record["device"]: record["state"] for record in records} == {"compass": "absent", "rudder": "absent"}
    assert "no such port" in records[0]["error"]
    assert "--seconds" in one_line_error(capsys, ["listen", vehicle(), "--seconds", "-1"])


def test_example_on_a_full_disk_leaves_no_file(tmp_path):
    command = f"ulimit -f 0; exec {sys.executable} -m firmware_py example {tmp_path / 'boat.toml'}"
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (
        2,
        f"rambler: {tmp_path / 'boat.toml'}: File too large; use another path\n",
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", ["firmware_py plan items", "hil scenarios"])
def test_closed_standard_streams_become_dev_null(words):
    command = f"exec {sys.executable} -m {words} <&- >&-"
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


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
    monkeypatch.setenv("XDG_STATE_HOME", "some/where")
    assert default_state_directory("Boat 1") == tmp_path / "home/.local/state/rambler/boat-1"
    text = "rambler: XDG_STATE_HOME=some/where is not absolute and is ignored; give an absolute path, or --state\n"
    assert capsys.readouterr().err == text
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert default_state_directory("Boat 1") == tmp_path / "rambler/boat-1"
    monkeypatch.setenv("XDG_STATE_HOME", "")
    assert default_state_directory("Boat 1") == tmp_path / "home/.local/state/rambler/boat-1"
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("words", [("run",), ("check",), ("calibrate", "rudder")])
def test_user_without_home_directory_needs_state(words, vehicle, monkeypatch, capsys):
    def nowhere():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", nowhere)
    assert "no home directory for the state; give a directory with --state" in one_line_error(
        capsys, [*words, vehicle()]
    )


def test_ctypes_is_not_imported_before_the_standard_streams_are_checked():
    """libffi opens a file with ctypes, which would become a closed standard input."""
    code = "import sys, firmware_py.__main__; sys.exit('ctypes' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0
