"""Transfers of files, logs, packed parameters and metadata between `rambler run` and MAVSDK or MAVProxy."""

import importlib.util
import json
import os
import random
import re
import shutil
import signal
import sys
from pathlib import Path

import pytest

from firmware_py.cli.params import format_qgc_file
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import format_file, parse_file
from firmware_py.link.parameters.files import parameter_json
from support.paths import log_bytes

CLIENT = Path(__file__).with_name("mavsdk_files_client.py")
NOT_USABLE = 77
SESSION_S = 90.0
LOGS = {1: 90 * 500, 2: 70_001}  # a multiple of the block size, and another size


def log_path(directory, number):
    return directory / "state" / "logs" / f"{number:08d}.BIN"


@pytest.fixture
def boat(tmp_path, boot, free_ports):
    """Start `rambler run` without devices, with two old logs; yield the port of the station."""
    log_path(tmp_path, 1).parent.mkdir(parents=True)
    rng = random.Random(5)
    for number, size in LOGS.items():
        log_path(tmp_path, number).write_bytes(rng.randbytes(size))
        os.utime(log_path(tmp_path, number), (1_700_000_000 + number, 1_700_000_000 + number))
    (port,) = free_ports(["udpout"])
    program = boot("boat", f"udpout:127.0.0.1:{port}")
    # The writer thread starts the thin log, on a slow computer after the first listing of a client.
    program.wait_for((log_path(tmp_path, 1).parent / "thin").is_dir, "no thin log")
    yield port
    program.send_signal(signal.SIGTERM)
    assert program.exit_code() == 0


def test_mavsdk_transfers_files_and_logs(tmp_path, start, boat):
    if importlib.util.find_spec("mavsdk") is None:
        pytest.skip("mavsdk is not installed; install the extra [clients]")
    directory = tmp_path / "client"
    directory.mkdir()
    upload = random.Random(6).randbytes(3000)
    (directory / "upload.plan").write_bytes(upload)
    # With its own home directory, because MAVSDK stores metadata by checksum.
    env = {**os.environ, "HOME": str(directory), "XDG_CACHE_HOME": str(directory / "cache")}
    client = start("mavsdk", [sys.executable, str(CLIENT), f"udpin://127.0.0.1:{boat}", str(directory)], env=env)
    code = client.exit_code(SESSION_S)
    if code == NOT_USABLE:
        pytest.skip(client.text().strip().splitlines()[-1])
    if code != 0:
        client.fail(f"the client ended with code {code}")
    results = json.loads((directory / "results.json").read_text())
    directories = ["@MISSION", "@PARAM", "logs", "metadata", "uploads"]
    assert results["root"] == [*(["DIRECTORY", name] for name in directories), ["FILE", "parameters.param"]]
    # Logs are listed with the suffix of compression, and can be requested without it.
    assert results["logs"][0] == ["DIRECTORY", "thin"]
    assert [name.removesuffix(".gz") for _, name in results["logs"][1:3]] == ["00000001.BIN", "00000002.BIN"]
    assert results["downloads"] == ["SUCCESS"] * 3
    assert (directory / "00000001.BIN").read_bytes() == log_bytes(tmp_path / "state", 1)
    assert (results["upload"], results["identical"]) == ("SUCCESS", True)
    assert results["changes"] == [
        *("SUCCESS", "FILE_EXISTS", "SUCCESS", "PROTOCOL_ERROR", "SUCCESS", "SUCCESS", "FILE_DOES_NOT_EXIST")
    ]
    assert results["refused"] == ["FILE_PROTECTED"] * 4
    check_logs(tmp_path, directory, results)
    metadata = {row["name"]: row for row in results["metadata"]["parameters"]}
    assert list(metadata) == [row.name for row in TABLE]
    assert (directory / "parameter.json").read_text() == json.dumps(results["metadata"], indent=1)


def check_logs(tmp_path, directory, results):
    assert [number for number, _, _ in results["entries"]] == [0, 1, 2]
    assert [size for _, _, size in results["entries"][1:]] == list(LOGS.values())
    assert [date for _, date, _ in results["entries"][1:]] == ["2023-11-14T22:13:21Z", "2023-11-14T22:13:22Z"]
    assert results["log_downloads"] == ["SUCCESS", "SUCCESS"]
    for number in LOGS:
        assert (directory / f"log{number}.bin").read_bytes() == log_bytes(tmp_path / "state", number)


def ask(client, line, pattern):
    client.say(line)
    return client.expect(pattern)


def test_mavproxy_transfers_files_logs_and_parameters(tmp_path, start, boat):
    script = shutil.which("mavproxy.py", path=str(Path(sys.executable).parent))
    if script is None:
        pytest.skip("mavproxy.py is not beside this Python; install the extra [clients]")
    home = tmp_path / "home"
    home.mkdir()
    (home / "up.bin").write_bytes(random.Random(7).randbytes(2000))
    command = [sys.executable, script, f"--master=udpin:127.0.0.1:{boat}", f"--state-basedir={home}"]
    client = start("mavproxy", command, cwd=home, env={**os.environ, "HOME": str(home), "PYTHONUNBUFFERED": "1"})
    client.expect(rf"Received {len(TABLE)} parameters \(ftp\)")
    client.expect(f"Saved {len(TABLE)} defaults")
    transfer_files(tmp_path, home, client)
    fetch_logs(tmp_path, home, client)
    transfer_parameters(home, client)
    client.hang_up()
    client.exit_code()


def transfer_files(tmp_path, home, client):
    ask(client, "ftp list /", r" D logs\s")
    ask(client, "ftp list /logs", r"00000002\.BIN(\.gz)?\t\d+\t2023-11-1")
    client.expect("Total size")
    # MAVProxy simulates a bad link that loses a quarter in each direction.
    for name in ("rx", "tx"):
        client.say(f"ftp set pkt_loss_{name} 25")
    client.say("ftp set loss_seed 7")
    size = int(ask(client, "ftp get /metadata/parameter.json got.json", r"Wrote (\d+) bytes to got.json").group(1))
    # MAVProxy prints the size before it closes the file.
    client.wait_for(lambda: (home / "got.json").stat().st_size == size, "got.json is not complete")
    assert (home / "got.json").read_text() == parameter_json()
    ask(client, "ftp put up.bin /uploads/up.bin", "Sent file of length 2000")
    for name in ("rx", "tx"):
        client.say(f"ftp set pkt_loss_{name} 0")
    checksum = ask(client, "ftp crclocal up.bin", r"crclocal: up.bin (0x\w+)").group(1)
    # The end of the upload may have been lost; another upload of the same file completes it.
    ask(client, "ftp put up.bin /uploads/up.bin", "Sent file of length 2000")
    assert ask(client, "ftp crc /uploads/up.bin", r"crc: /uploads/up.bin (0x\w+)").group(1) == checksum
    client.say("ftp rm /uploads/up.bin")
    client.expect("Removing /uploads/up.bin")
    uploads = tmp_path / "state" / "uploads"
    client.wait_for(lambda: not list(uploads.iterdir()), "the upload was not removed")
    ask(client, "ftp put up.bin /logs/up.bin", "Create failed")
    ask(client, "ftp get /logs/00000001.BIN got.bin", rf"Wrote {LOGS[1]} bytes to got.bin")
    client.wait_for(lambda: (home / "got.bin").stat().st_size == LOGS[1], "got.bin is not complete")
    assert (home / "got.bin").read_bytes() == log_bytes(tmp_path / "state", 1)


def fetch_logs(tmp_path, home, client):
    client.say("log list")
    client.expect(rf"Log 2  numLogs 3 lastLog 2 size {LOGS[2]} ")
    for number, size in LOGS.items():
        ask(client, f"log download {number} log{number}.bin", rf"Finished downloading log{number}.bin \({size} ")
        assert (home / f"log{number}.bin").read_bytes() == log_bytes(tmp_path / "state", number)


def transfer_parameters(home, client):
    """Read a file that MAVProxy saved; let MAVProxy load a file and send packed parameters."""
    client.say("param set CTL_K1 37.5")
    client.wait_for(lambda: ask(client, "param show CTL_K1", r"CTL_K1 +(\S+)").group(1) == "37.5", "CTL_K1 was not set")
    ask(client, "param save saved.parm", rf"Saved {len(TABLE)} parameters to saved.parm")
    saved = parse_file((home / "saved.parm").read_text(), "saved.parm")
    assert [saved.pop(row.name) for row in TABLE if row.read_only] == [1.0, 0.0, 1.0]
    assert saved == {row.name: 37.5 if row.name == "CTL_K1" else row.default for row in TABLE if not row.read_only}
    settings = {row.name: row.default for row in TABLE if not row.read_only}
    (home / "ours.param").write_text(format_file({**settings, "CTL_K1": 41.25, "EST_TAU_S": 1.7}))
    loaded = ask(client, "param load ours.param", r"Loaded (\d+) parameters from ours.param \(changed 2\)")
    assert int(loaded.group(1)) == len(settings)
    (home / "packed.param").write_text(format_file({**settings, "CTL_K1": 42.0, "EST_TAU_S": 1.9}))
    ask(client, "param ftpload packed.param", "Parameter upload done")
    size = int(ask(client, "ftp get parameters.param now.param", r"Wrote (\d+) bytes to now.param").group(1))
    client.wait_for(lambda: (home / "now.param").stat().st_size == size, "now.param is not complete")
    now = parse_file((home / "now.param").read_text(), "now.param")
    assert (now["CTL_K1"], now["EST_TAU_S"]) == (42.0, pytest.approx(1.9))
    assert re.search(r"takes effect", client.text()) is None


def test_parameter_file_of_qgroundcontrol_is_read_back():
    values = {row.name: row.default for row in TABLE}
    text = format_qgc_file(values)
    assert "1\t1\tBOOT_ARM\t0\t6" in text.splitlines()
    assert parse_file(text, "file") == values
