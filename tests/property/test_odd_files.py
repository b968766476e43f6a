"""Files that are none, have no end or are written to break a reader: one line, exit 2, by every command."""

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


def gigabytes(path):
    path.touch()
    os.truncate(path, 5 << 30)


ODD = {
    "a pipe": os.mkfifo,
    "a device": lambda path: path.symlink_to("/dev/zero"),
    "gigabytes": gigabytes,
    "a directory": os.mkdir,
}


def name_of(reader):
    return " ".join(word for word in reader[1][:2] if "{" not in word) + reader[1][-1][2:]


def refused(reader, path, capfd):
    """Return the line that a command refuses a file with."""
    program, words = reader
    assert program([word.format(path, dir=path.parent) for word in words]) == 2
    output, errors = capfd.readouterr()
    (line,) = errors.splitlines()
    assert output == ""
    return line


@pytest.mark.parametrize("reader", READERS, ids=name_of)
def test_what_is_no_file_or_has_no_end_is_refused_at_once_by_name(reader, tmp_path, capfd):
    for odd, make in ODD.items():
        path = tmp_path / odd / ("odd.BIN" if reader[1][-1].endswith(".BIN") else "odd")
        path.parent.mkdir()
        make(path)
        assert "odd" in refused(reader, path.with_suffix(""), capfd), odd


def test_so_is_a_parameter_file_that_a_vehicle_file_names(tmp_path, capfd):
    for odd, make in ODD.items():
        (tmp_path / odd).mkdir()
        (tmp_path / odd / "boat.toml").write_text(VEHICLE)
        make(tmp_path / odd / "boat.param")
        assert "boat.param" in refused(VEHICLE_READERS[0], tmp_path / odd / "boat.toml", capfd), odd


@pytest.mark.parametrize("odd", ODD)
def test_so_is_a_state_directory_that_a_run_is_to_begin_with(odd, tmp_path, capfd):
    (tmp_path / "kept").mkdir()
    ODD[odd](tmp_path / "kept" / "mission.plan.0")
    if odd == "a directory":
        (tmp_path / "kept" / "mission.plan.0" / "link").symlink_to("/dev/zero")
    words = ["run", "tank", "--state", "{}", "--out", "{dir}/out", "--seconds", "1", "--goal", "0:0"]
    assert "mission.plan.0" in refused((rambler_hil, words), tmp_path / "kept", capfd)


@pytest.mark.parametrize("odd", ODD)
def test_an_invalid_slot_of_a_plan_is_reported_and_the_other_is_read(odd, tmp_path, capfd):
    store = Store(tmp_path)
    for content in (b"1", b"2", b"3"):
        store.save("a", content)
        store.when_stored(("a",), lambda _: None)
    store.close()
    ODD[odd](tmp_path / "fence.plan.0")
    assert rambler(["plan", "show", "--state", str(tmp_path)]) == 0
    assert "fence.plan.0 cannot be read" in capfd.readouterr().err


@pytest.mark.parametrize("program", [rambler, rambler_hil])
def test_a_nul_in_any_word_is_one_line(program, tmp_path, capfd):
    words = {rambler: (READERS[0], READERS[6]), rambler_hil: (READERS[3], READERS[11])}[program]
    for reader in words:
        assert "NUL" in refused(reader, tmp_path / "a\0b", capfd)


def filled(old, new):
    assert old in VEHICLE
    return VEHICLE.replace(old, new, 1)


CONTENTS = {
    "nested deep": "x = " + 5000 * "[" + 5000 * "]",
    "nested inline": "x = " + 2000 * "{a = " + "1" + 2000 * "}",
    "5000 digits": filled("4800", 5000 * "1"),
    "5000 hexadecimal digits": filled('"nmea"', "0x" + 5000 * "f"),
    "400 digits": filled("4800", 400 * "1"),
    "a name of 400 digits": filled('"boat"', 400 * "1"),
    "NUL in a port": filled("none-a", "\\u0000"),
    "NUL in a host": filled("127.0.0.1", "\\u0000"),
    "NUL in a path": filled("boat.param", "a\\u0000b"),
    "NUL in a name": filled('name = "boat"', 'name = "a\\u0000b"'),
    "NUL as a key": '"\\u0000" = 1\n' + VEHICLE,
    "no text": "\udcff",
}


@pytest.mark.parametrize("reader", VEHICLE_READERS, ids=name_of)
def test_a_vehicle_file_that_breaks_a_reader_is_one_line(reader, tmp_path, capfd):
    (tmp_path / "boat.param").write_text("")
    for name, content in CONTENTS.items():
        (tmp_path / "boat.toml").write_text(content, errors="surrogateescape")
        line = refused(reader, tmp_path / "boat.toml", capfd)
        assert "boat.toml" in line, name
        assert len(line) < 2000, name


VALUES = [
    400 * "9",
    "0x" + 1000 * "f",
    "1e999",
    "nan",
    "-" + 400 * "9",
    "1979-05-27",
    '"\\u0000"',
    "[[]]",
    "{}",
    "true",
]


@pytest.mark.parametrize("line", [line for line in VEHICLE.splitlines() if "=" in line])
def test_no_value_of_any_kind_in_any_place_breaks_a_reader(line, tmp_path, capfd):
    (tmp_path / "boat.param").write_text("")
    name = line.split(" = ")[0]
    for value in VALUES:
        (tmp_path / "boat.toml").write_text(filled(line, f"{name} = {value}"))
        assert "boat.toml" in refused(VEHICLE_READERS[5], tmp_path / "boat.toml", capfd), value
