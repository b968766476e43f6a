"""Pipes, devices, large files, directories and malformed contents: each command prints one line and exits with 2."""

import os

import pytest

from firmware_py.__main__ import main as rambler
from firmware_py.system.store import Store
from hil.__main__ import main as rambler_hil

VEHICLE = """
[vehicle]
name = "boat"
[compass]
driver = "nmea"
port = "/dev/none-a"
baud = 4800
sentences = ["HDT"]
[rudder]
driver = "dynamixel"
port = "/dev/none-b"
baud = 57600
id = 1
[link]
urls = ["udpin:127.0.0.1:1"]
[hull]
length_m = 2
[parameters]
CTL_K1 = 41
file = "boat.param"
"""
VEHICLE_READERS = [
    (rambler, ["run", "{}", "--state", "{dir}/state"]),
    (rambler, ["listen", "{}", "--seconds", "0.2"]),
    (rambler, ["check", "{}", "--state", "{dir}/state"]),
    (rambler_hil, ["run", "tank", "--vehicle", "{}", "--out", "{dir}/out"]),
    (rambler_hil, ["tune", "--vehicle", "{}"]),
    (rambler_hil, ["similarity", "--vehicle", "{}"]),
]
READERS = [
    *VEHICLE_READERS,
    (rambler, ["decode", "nmea", "{}"]),
    (rambler, ["replay", "{}"]),
    (rambler, ["params", "{}"]),
    (rambler, ["plan", "check", "{}"]),
    (rambler, ["plan", "load", "{}", "--state", "{dir}"]),
    (rambler_hil, ["identify", "{}"]),
    (rambler_hil, ["identify", "{}.BIN"]),
    (rambler_hil, ["bench", "--figures", "{}"]),
    (rambler_hil, ["compare", "--figures", "{}"]),
    (rambler_hil, ["campaign", "{}", "--out", "{dir}/out"]),
]


def make_large_file(path):
    path.touch()
    os.truncate(path, 5 << 30)


UNREADABLE = {
    "a pipe": os.mkfifo,
    "a device": lambda path: path.symlink_to("/dev/zero"),
    "gigabytes": make_large_file,
    "a directory": os.mkdir,
}


def reader_name(reader):
    return " ".join(word for word in reader[1][:2] if "{" not in word) + reader[1][-1][2:]


def refused(reader, path, capfd):
    """Return the one-line error of a command for a file."""
    program, words = reader
    assert program([word.format(path, dir=path.parent) for word in words]) == 2
    output, errors = capfd.readouterr()
    (line,) = errors.splitlines()
    assert output == ""
    return line


@pytest.mark.parametrize("reader", READERS, ids=reader_name)
def test_unreadable_file_is_refused_by_name(reader, tmp_path, capfd):
    for kind, make_file in UNREADABLE.items():
        path = tmp_path / kind / ("odd.BIN" if reader[1][-1].endswith(".BIN") else "odd")
        path.parent.mkdir()
        make_file(path)
        assert "odd" in refused(reader, path.with_suffix(""), capfd), kind


def test_unreadable_parameter_file_of_a_vehicle_file_is_refused(tmp_path, capfd):
    for kind, make_file in UNREADABLE.items():
        (tmp_path / kind).mkdir()
        (tmp_path / kind / "boat.toml").write_text(VEHICLE)
        make_file(tmp_path / kind / "boat.param")
        assert "boat.param" in refused(VEHICLE_READERS[0], tmp_path / kind / "boat.toml", capfd), kind


@pytest.mark.parametrize("kind", UNREADABLE)
def test_state_directory_with_unreadable_files_is_refused_by_a_run(kind, tmp_path, capfd):
    (tmp_path / "kept").mkdir()
    UNREADABLE[kind](tmp_path / "kept" / "mission.plan.0")
    if kind == "a directory":
        (tmp_path / "kept" / "mission.plan.0" / "link").symlink_to("/dev/zero")
    words = ["run", "tank", "--state", "{}", "--out", "{dir}/out", "--seconds", "1", "--goal", "0:0"]
    assert "mission.plan.0" in refused((rambler_hil, words), tmp_path / "kept", capfd)


@pytest.mark.parametrize("kind", UNREADABLE)
def test_unreadable_slot_of_a_plan_is_reported(kind, tmp_path, capfd):
    store = Store(tmp_path)
    for content in (b"1", b"2", b"3"):
        store.save("a", content)
        store.when_stored(("a",), lambda _: None)
    store.close()
    UNREADABLE[kind](tmp_path / "fence.plan.0")
    assert rambler(["plan", "show", "--state", str(tmp_path)]) == 0
    assert "fence.plan.0 cannot be read" in capfd.readouterr().err


@pytest.mark.parametrize("program", [rambler, rambler_hil])
def test_nul_in_an_argument_is_a_one_line_error(program, tmp_path, capfd):
    words = {rambler: (READERS[0], READERS[6]), rambler_hil: (READERS[3], READERS[11])}[program]
    for reader in words:
        assert "NUL" in refused(reader, tmp_path / "a\0b", capfd)


def replace_in_vehicle(old, new):
    assert old in VEHICLE
    return VEHICLE.replace(old, new, 1)


CONTENTS = {
    "nested deep": "x = " + 5000 * "[" + 5000 * "]",
    "nested inline": "x = " + 2000 * "{a = " + "1" + 2000 * "}",
    "5000 digits": replace_in_vehicle("4800", 5000 * "1"),
    "5000 hexadecimal digits": replace_in_vehicle('"nmea"', "0x" + 5000 * "f"),
    "400 digits": replace_in_vehicle("4800", 400 * "1"),
    "a name of 400 digits": replace_in_vehicle('"boat"', 400 * "1"),
    "NUL in a port": replace_in_vehicle("none-a", "\\u0000"),
    "NUL in a host": replace_in_vehicle("127.0.0.1", "\\u0000"),
    "NUL in a path": replace_in_vehicle("boat.param", "a\\u0000b"),
    "NUL in a name": replace_in_vehicle('name = "boat"', 'name = "a\\u0000b"'),
    "NUL as a key": '"\\u0000" = 1\n' + VEHICLE,
    "no text": "\udcff",
}


@pytest.mark.parametrize("reader", VEHICLE_READERS, ids=reader_name)
def test_malformed_vehicle_file_is_a_one_line_error(reader, tmp_path, capfd):
    (tmp_path / "boat.param").write_text("")
    for name, content in CONTENTS.items():
        (tmp_path / "boat.toml").write_text(content, errors="surrogateescape")
        line = refused(reader, tmp_path / "boat.toml", capfd)
        assert "boat.toml" in line, name
        assert len(line) < 2000, name


LARGE = (400 * "9", "-" + 400 * "9", "0x" + 1000 * "f", "1e999")
VALUES = (*LARGE, "nan", "1979-05-27", '"\\u0000"', "[[]]", "{}", "true")


@pytest.mark.parametrize("line", [line for line in VEHICLE.splitlines() if "=" in line])
def test_invalid_value_of_any_key_is_a_one_line_error(line, tmp_path, capfd):
    (tmp_path / "boat.param").write_text("")
    name = line.split(" = ")[0]
    for value in VALUES:
        (tmp_path / "boat.toml").write_text(replace_in_vehicle(line, f"{name} = {value}"))
        assert "boat.toml" in refused(VEHICLE_READERS[5], tmp_path / "boat.toml", capfd), value
