"""Files, logs, packed parameters and metadata, fetched and sent by MAVSDK and MAVProxy from `rambler run` itself."""

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
CANNOT_BE_HAD = 77
SESSION_S = 90.0
LOGS = {1: 90 * 500, 2: 70_001}  # a whole number of blocks, and not


def log_path(directory, number):
    return directory / "state" / "logs" / f"{number:08d}.BIN"


@pytest.fixture
def boat(tmp_path, boot, free_ports):
    """`rambler run` without any device, with two old logs; the port that it speaks to."""
    log_path(tmp_path, 1).parent.mkdir(parents=True)
    noise = random.Random(5)
    for number, size in LOGS.items():
        log_path(tmp_path, number).write_bytes(noise.randbytes(size))
        os.utime(log_path(tmp_path, number), (1_700_000_000 + number, 1_700_000_000 + number))
    (port,) = free_ports(["udpout"])
    program = boot("boat", f"udpout:127.0.0.1:{port}")
    # The thin log begins on the writer's own thread, on a slow computer after a client's first look.
    program.wait_for((log_path(tmp_path, 1).parent / "thin").is_dir, "no thin log")
    yield port
    program.send_signal(signal.SIGTERM)
    assert program.exit_code() == 0


def test_mavsdk_moves_files_and_logs(tmp_path, start, boat):
    if importlib.util.find_spec("mavsdk") is None:
        pytest.skip("mavsdk is not installed; install the extra [clients]")
    directory = tmp_path / "client"
    directory.mkdir()
    upload = random.Random(6).randbytes(3000)
    (directory / "upload.plan").write_bytes(upload)
    # A home of its own: MAVSDK keeps metadata by checksum.
    env = {**os.environ, "HOME": str(directory), "XDG_CACHE_HOME": str(directory / "cache")}
    client = start("mavsdk", [sys.executable, str(CLIENT), f"udpin://127.0.0.1:{boat}", str(directory)], env=env)
    code = client.exit_code(SESSION_S)
    if code == CANNOT_BE_HAD:
        pytest.skip(client.text().strip().splitlines()[-1])
    if code != 0:
        client.fail(f"it ended with code {code}")
    seen = json.loads((directory / "results.json").read_text())
    directories = ["@MISSION", "@PARAM", "logs", "metadata", "uploads"]
    assert seen["root"] == [*(["DIRECTORY", name] for name in directories), ["FILE", "parameters.param"]]
    # Listed as they lie there, compressed or not yet, and had by their first names all the same.
    assert seen["logs"][0] == ["DIRECTORY", "thin"]
    assert [name.removesuffix(".gz") for _, name in seen["logs"][1:3]] == ["00000001.BIN", "00000002.BIN"]
    assert seen["downloads"] == ["SUCCESS"] * 3
    assert (directory / "00000001.BIN").read_bytes() == log_bytes(tmp_path / "state", 1)
    assert (seen["upload"], seen["identical"]) == ("SUCCESS", True)
    assert seen["changes"] == [
        *("SUCCESS", "FILE_EXISTS", "SUCCESS", "PROTOCOL_ERROR", "SUCCESS", "SUCCESS", "FILE_DOES_NOT_EXIST")
    ]
    assert seen["refused"] == ["FILE_PROTECTED"] * 4
    check_logs(tmp_path, directory, seen)
    metadata = {row["name"]: row for row in seen["metadata"]["parameters"]}
    assert list(metadata) == [row.name for row in TABLE]
    assert (directory / "parameter.json").read_text() == json.dumps(seen["metadata"], indent=1)


def check_logs(tmp_path, directory, seen):
    assert [number for number, _, _ in seen["entries"]] == [0, 1, 2]
    assert [size for _, _, size in seen["entries"][1:]] == list(LOGS.values())
    assert [date for _, date, _ in seen["entries"][1:]] == ["2023-11-14T22:13:21Z", "2023-11-14T22:13:22Z"]
    assert seen["log_downloads"] == ["SUCCESS", "SUCCESS"]
    for number in LOGS:
        assert (directory / f"log{number}.bin").read_bytes() == log_bytes(tmp_path / "state", number)


def ask(client, line, pattern):
    client.say(line)
    return client.expect(pattern)


def test_mavproxy_moves_files_logs_and_parameters(tmp_path, start, boat):
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
    move_files(tmp_path, home, client)
    fetch_logs(tmp_path, home, client)
    move_parameters(home, client)
    client.hang_up()
    client.exit_code()


def move_files(tmp_path, home, client):
    ask(client, "ftp list /", r" D logs\s")
    ask(client, "ftp list /logs", r"00000002\.BIN(\.gz)?\t\d+\t2023-11-1")
    client.expect("Total size")
    # Through MAVProxy's own simulation of a bad link: a quarter is lost, both ways.
    for name in ("rx", "tx"):
        client.say(f"ftp set pkt_loss_{name} 25")
    client.say("ftp set loss_seed 7")
    size = int(ask(client, "ftp get /metadata/parameter.json got.json", r"Wrote (\d+) bytes to got.json").group(1))
    # MAVProxy says what it wrote before it closes the file.
    client.wait_for(lambda: (home / "got.json").stat().st_size == size, "got.json is not whole")
    assert (home / "got.json").read_text() == parameter_json()
    ask(client, "ftp put up.bin /uploads/up.bin", "Sent file of length 2000")
    for name in ("rx", "tx"):
        client.say(f"ftp set pkt_loss_{name} 0")
    ours = ask(client, "ftp crclocal up.bin", r"crclocal: up.bin (0x\w+)").group(1)
    # The end of the upload may have been lost; the next one of the same file brings it into its place.
    ask(client, "ftp put up.bin /uploads/up.bin", "Sent file of length 2000")
    assert ask(client, "ftp crc /uploads/up.bin", r"crc: /uploads/up.bin (0x\w+)").group(1) == ours
    client.say("ftp rm /uploads/up.bin")
    client.expect("Removing /uploads/up.bin")
    uploads = tmp_path / "state" / "uploads"
    client.wait_for(lambda: not list(uploads.iterdir()), "the upload was not removed")
    ask(client, "ftp put up.bin /logs/up.bin", "Create failed")
    ask(client, "ftp get /logs/00000001.BIN got.bin", rf"Wrote {LOGS[1]} bytes to got.bin")
    client.wait_for(lambda: (home / "got.bin").stat().st_size == LOGS[1], "got.bin is not whole")
    assert (home / "got.bin").read_bytes() == log_bytes(tmp_path / "state", 1)


def fetch_logs(tmp_path, home, client):
    client.say("log list")
    client.expect(rf"Log 2  numLogs 3 lastLog 2 size {LOGS[2]} ")
    for number, size in LOGS.items():
        ask(client, f"log download {number} log{number}.bin", rf"Finished downloading log{number}.bin \({size} ")
        assert (home / f"log{number}.bin").read_bytes() == log_bytes(tmp_path / "state", number)


def move_parameters(home, client):
    """Files that MAVProxy saves are read here, those written here are loaded there, and packed ones sent."""
    client.say("param set CTL_K1 37.5")
    client.wait_for(lambda: ask(client, "param show CTL_K1", r"CTL_K1 +(\S+)").group(1) == "37.5", "it was not set")
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
    client.wait_for(lambda: (home / "now.param").stat().st_size == size, "now.param is not whole")
    now = parse_file((home / "now.param").read_text(), "now.param")
    assert (now["CTL_K1"], now["EST_TAU_S"]) == (42.0, pytest.approx(1.9))
    assert re.search(r"takes effect", client.text()) is None


def test_a_file_of_qgroundcontrols_kind_is_read_back():
    values = {row.name: row.default for row in TABLE}
    text = format_qgc_file(values)
    assert "1\t1\tBOOT_ARM\t0\t6" in text.splitlines()
    assert parse_file(text, "file") == values
