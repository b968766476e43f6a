"""`rambler key`: states, valid and invalid keys."""

import errno
import io
import json
import os
import pty
import stat
from hashlib import sha256
from pathlib import Path

import pytest

from firmware_py.__main__ import main
from firmware_py.link.signing import KeyState, find_key
from firmware_py.system.state_directory import read_key
from firmware_py.system.store import Store

PASSPHRASE = b"seaworthy"
KEY = sha256(PASSPHRASE).digest()


@pytest.fixture
def directory(tmp_path):
    (tmp_path / "state").mkdir()
    return tmp_path / "state"


@pytest.fixture
def set_input(monkeypatch):
    """Replace standard input by bytes."""
    return lambda data: monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data)))


@pytest.fixture
def directory_with_key(directory, set_input, capsys):
    set_input(PASSPHRASE)
    assert main(["key", "set", "--state", str(directory)]) == 0
    capsys.readouterr()
    return directory


def stored_key(directory):
    record = find_key(read_key(directory)).record
    return record and record.key


def run_rejected(capsys, *arguments):
    """Run `rambler key`, which must fail with exit code 2; return its error, which must be one line."""
    assert main(["key", *map(str, arguments)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    return line


def read_state(capsys, directory):
    assert main(["key", "show-state", "--state", str(directory), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_key_is_set_and_removed_and_only_its_state_is_shown(directory, set_input, capsys):
    assert read_state(capsys, directory) == {"state": "absent", "problem": "", "readable_by_others": []}
    set_input(PASSPHRASE + b"\n")
    assert main(["key", "set", "--state", str(directory)]) == 0
    assert main(["key", "show-state", "--state", str(directory)]) == 0
    assert capsys.readouterr().out == 2 * f"{directory}: present\n"
    assert stored_key(directory) == KEY
    paths = sorted(directory.glob("signing.key.*"))
    assert {stat.S_IMODE(path.stat().st_mode) for path in paths} == {0o600}
    assert [KEY.hex().encode() in path.read_bytes() for path in paths] == [True, True]
    assert main(["key", "remove", "--state", str(directory), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"state": "absent"}
    assert not any(KEY.hex().encode() in path.read_bytes() for path in paths)


def test_passphrase_has_up_to_1024_bytes(directory, set_input):
    set_input(b"x" * 1024)
    assert main(["key", "set", "--state", str(directory)]) == 0
    assert stored_key(directory) == sha256(b"x" * 1024).digest()


def test_error_of_the_directory_is_reported(directory, capsys, monkeypatch):
    def fail(_directory):
        raise OSError(errno.EIO, "Input/output error", str(directory))

    monkeypatch.setattr("firmware_py.cli.key.read_key", fail)
    assert run_rejected(capsys, "show-state", "--state", directory) == (
        f"rambler key show-state: {directory}: Input/output error"
    )


def test_damage_of_one_slot_is_named(directory_with_key, capsys):
    (directory_with_key / "signing.key.1").write_bytes(b"spoilt")
    assert main(["key", "show-state", "--state", str(directory_with_key)]) == 0
    assert capsys.readouterr().out == f"{directory_with_key}: present: signing.key.1 is damaged\n"


@pytest.mark.parametrize("data", [b"two words", b"two words\n", b"two words\r\n"])
def test_passphrase_is_read_from_file_or_standard_input(data, directory, set_input, tmp_path):
    set_input(data)
    assert main(["key", "set", "--state", str(directory)]) == 0
    assert stored_key(directory) == sha256(b"two words").digest()
    (tmp_path / "passphrase.txt").write_bytes(data.replace(b"two", b"deux"))
    assert main(["key", "set", "--state", str(directory), "--key-file", str(tmp_path / "passphrase.txt")]) == 0
    assert stored_key(directory) == sha256(b"deux words").digest()


def test_hex_digits_are_a_key_only_with_the_option(directory, set_input):
    digits = "0123456789abcdefABCDEF9876543210" * 2
    for options, key in (([], sha256(digits.encode()).digest()), (["--hex"], bytes.fromhex(digits))):
        set_input(digits.encode())
        assert main(["key", "set", *options, "--state", str(directory)]) == 0
        assert stored_key(directory) == key


@pytest.mark.parametrize(
    ("data", "options", "reason"),
    [
        (b"", (), "the input must be one line of text"),
        (b"\n", (), "the input must be one line of text"),
        (b"two\nlines\n", (), "the input must be one line of text"),
        (b"\xff\xfe", (), "the input must be one line of text"),
        (b"x" * 1025, (), "1 to 1024 bytes"),
        (b"0" * 63, ("--hex",), "64 hexadecimal digits"),
        (b"g" * 64, ("--hex",), "64 hexadecimal digits"),
        (b"0" * 64, ("--hex",), "a key must not be all zeros"),
    ],
)
def test_invalid_key_is_refused_and_the_old_one_stays(data, options, reason, directory_with_key, set_input, capsys):
    set_input(data)
    assert reason in run_rejected(capsys, "set", "--state", directory_with_key, *options)
    assert stored_key(directory_with_key) == KEY


def test_key_as_argument_is_refused(directory, capsys):
    assert "-h" in run_rejected(capsys, "set", "seaworthy", "--state", directory)
    assert stored_key(directory) is None


@pytest.mark.parametrize(
    "arguments",
    [("show-state",), ("remove",), ("set", "--key-file", "none")],
    ids=lambda arguments: arguments[0],
)
def test_missing_directory_or_key_file_is_refused(arguments, tmp_path, directory, capsys):
    assert "does not exist" in run_rejected(capsys, *arguments, "--state", tmp_path / "none")
    assert not (tmp_path / "none").exists()
    if arguments[0] == "set":
        assert "give a readable file" in run_rejected(capsys, *arguments, "--state", directory)


@pytest.mark.parametrize("command", ["set", "remove"])
def test_key_of_a_running_autopilot_is_not_changed(command, directory_with_key, set_input, capsys):
    autopilot = Store(directory_with_key)
    try:
        set_input(b"another")
        assert "end that one, or set the key over a trusted link" in run_rejected(
            capsys, command, "--state", directory_with_key
        )
        assert read_state(capsys, directory_with_key)["state"] == "present"
    finally:
        autopilot.close()
    assert stored_key(directory_with_key) == KEY


@pytest.mark.parametrize("command", ["set", "remove"])
def test_only_the_owner_changes_the_key(command, directory, set_input, capsys, monkeypatch):
    """The autopilot does not accept files of another user, not even of root: the key would be lost."""
    monkeypatch.setattr(os, "geteuid", lambda: 54321)
    set_input(PASSPHRASE)
    assert "run this as that user" in run_rejected(capsys, command, "--state", directory)


def test_full_standard_output_is_a_disk_error(directory_with_key, capsys, monkeypatch):
    with Path("/dev/full").open("wb", buffering=0) as full:
        monkeypatch.setattr("sys.stdout", io.TextIOWrapper(full, write_through=True))
        assert main(["key", "show-state", "--state", str(directory_with_key)]) == 2
    assert capsys.readouterr().err.startswith("rambler: a disk is full (see df)")


def test_state_of_a_lost_key_names_the_damage_and_the_key_can_be_removed(directory_with_key, capsys):
    for path in directory_with_key.glob("signing.key.*"):
        path.write_bytes(b"")
        path.chmod(0o644)
    problem = "signing.key.0 is damaged, signing.key.1 is damaged"
    names = ["signing.key.0", "signing.key.1"]
    assert read_state(capsys, directory_with_key) == {"state": "lost", "problem": problem, "readable_by_others": names}
    assert main(["key", "remove", "--state", str(directory_with_key)]) == 0
    assert find_key(read_key(directory_with_key)).state is KeyState.ABSENT


def test_key_of_another_user_is_unreadable_not_lost(directory_with_key, capsys, monkeypatch):
    def raise_denied(*_arguments):
        raise PermissionError(13, "denied")

    monkeypatch.setattr(os, "geteuid", lambda: 54321)
    monkeypatch.setattr("os.read", raise_denied)
    result = read_state(capsys, directory_with_key)
    problem = "signing.key.0 cannot be read (denied), signing.key.1 cannot be read (denied); run this as"
    assert (result["state"], result["problem"].startswith(problem)) == ("unreadable", True)


def test_write_error_is_reported(directory, set_input, capsys, monkeypatch):
    def raise_full(*_arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    set_input(PASSPHRASE)
    monkeypatch.setattr(os, "pwrite", raise_full)
    assert "signing.key cannot be stored" in run_rejected(capsys, "set", "--state", directory)
    assert read_state(capsys, directory)["state"] == "absent"


@pytest.mark.parametrize(("second_entry", "exit_code"), [("seaworthy", 0), ("seawrothy", 2)])
def test_terminal_asks_for_the_passphrase_twice(second_entry, exit_code, directory, capsys, monkeypatch):
    keyboard, terminal = pty.openpty()
    entries, prompts = iter(("seaworthy", second_entry)), []

    def read_entry(prompt):
        prompts.append(prompt)
        return next(entries)

    with os.fdopen(terminal, encoding="utf-8") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        monkeypatch.setattr("getpass.getpass", read_entry)
        assert main(["key", "set", "--state", str(directory)]) == exit_code
    os.close(keyboard)
    assert prompts == ["Passphrase: ", "Passphrase again: "]
    assert ("the two entries differ" in capsys.readouterr().err) is bool(exit_code)
    assert stored_key(directory) == (None if exit_code else KEY)
