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
from firmware_py.system.state_directory import stored_key
from firmware_py.system.store import Store

PASSPHRASE = b"seaworthy"
KEY = sha256(PASSPHRASE).digest()


@pytest.fixture
def state(tmp_path):
    (tmp_path / "state").mkdir()
    return tmp_path / "state"


@pytest.fixture
def typed(monkeypatch):
    """Write bytes to standard input."""

    def give(data):
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data)))

    return give


@pytest.fixture
def keyed(state, typed, capsys):
    """A state directory with a key."""
    typed(PASSPHRASE)
    assert main(["key", "set", "--state", str(state)]) == 0
    capsys.readouterr()
    return state


def key_in(directory):
    record = find_key(stored_key(directory)).record
    return record and record.key


def refused(capsys, *words):
    assert main(["key", *map(str, words)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    return line


def state_of(capsys, directory):
    assert main(["key", "show-state", "--state", str(directory), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_key_is_set_shown_as_state_only_and_removed(state, typed, capsys):
    assert state_of(capsys, state) == {"state": "absent", "problem": "", "readable_by_others": []}
    typed(PASSPHRASE + b"\n")
    assert main(["key", "set", "--state", str(state)]) == 0
    assert capsys.readouterr().out == f"{state}: present\n"
    assert key_in(state) == KEY
    files = sorted(state.glob("signing.key.*"))
    assert {stat.S_IMODE(path.stat().st_mode) for path in files} == {0o600}
    assert [KEY.hex().encode() in path.read_bytes() for path in files] == [True, True]
    assert main(["key", "show-state", "--state", str(state)]) == 0
    assert capsys.readouterr().out == f"{state}: present\n"
    assert main(["key", "remove", "--state", str(state), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"state": "absent"}
    assert not any(KEY.hex().encode() in path.read_bytes() for path in files)


@pytest.mark.parametrize("data", [b"two words", b"two words\n", b"two words\r\n"])
def test_passphrase_is_read_from_file_or_standard_input(data, state, typed, tmp_path):
    typed(data)
    assert main(["key", "set", "--state", str(state)]) == 0
    assert key_in(state) == sha256(b"two words").digest()
    (tmp_path / "words").write_bytes(data.replace(b"two", b"deux"))
    assert main(["key", "set", "--state", str(state), "--key-file", str(tmp_path / "words")]) == 0
    assert key_in(state) == sha256(b"deux words").digest()


def test_hex_digits_are_a_key_only_with_the_option(state, typed):
    digits = "0123456789abcdefABCDEF9876543210" * 2
    typed(digits.encode())
    assert main(["key", "set", "--state", str(state)]) == 0
    assert key_in(state) == sha256(digits.encode()).digest()
    typed(digits.encode())
    assert main(["key", "set", "--hex", "--state", str(state)]) == 0
    assert key_in(state) == bytes.fromhex(digits)


@pytest.mark.parametrize(
    ("data", "more", "reason"),
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
def test_invalid_key_is_refused_and_the_old_one_stays(data, more, reason, keyed, typed, capsys):
    typed(data)
    assert reason in refused(capsys, "set", "--state", keyed, *more)
    assert key_in(keyed) == KEY


def test_key_is_never_an_argument(state, capsys):
    assert "-h" in refused(capsys, "set", "seaworthy", "--state", state)
    assert key_in(state) is None


@pytest.mark.parametrize("words", [("show-state",), ("remove",), ("set", "--key-file", "none")])
def test_missing_directory_or_key_file_is_an_error(words, tmp_path, state, capsys):
    assert "does not exist" in refused(capsys, *words, "--state", tmp_path / "none")
    assert not (tmp_path / "none").exists()
    if words[0] == "set":
        assert "give a readable file" in refused(capsys, *words, "--state", state)


def test_key_of_a_running_autopilot_is_not_changed(keyed, typed, capsys):
    autopilot = Store(keyed)
    try:
        typed(b"another")
        assert "end that one, or set the key over a trusted link" in refused(capsys, "set", "--state", keyed)
        assert "end that one, or set the key over a trusted link" in refused(capsys, "remove", "--state", keyed)
        assert state_of(capsys, keyed)["state"] == "present"
    finally:
        autopilot.close()
    assert key_in(keyed) == KEY


def test_only_the_owner_changes_the_key(state, typed, capsys, monkeypatch):
    """The autopilot does not accept files of another user, not even of root: the key would be lost."""
    monkeypatch.setattr(os, "geteuid", lambda: 54321)
    typed(PASSPHRASE)
    assert "run this as that user" in refused(capsys, "set", "--state", state)
    assert "run this as that user" in refused(capsys, "remove", "--state", state)


def test_full_standard_output_is_a_disk_error(keyed, capsys, monkeypatch):
    with Path("/dev/full").open("wb", buffering=0) as full:
        monkeypatch.setattr("sys.stdout", io.TextIOWrapper(full, write_through=True))
        assert main(["key", "show-state", "--state", str(keyed)]) == 2
    assert capsys.readouterr().err.startswith("rambler: a disk is full (see df)")


def test_lost_key_has_a_cause_and_can_be_removed(keyed, capsys):
    for path in keyed.glob("signing.key.*"):
        path.write_bytes(b"")
        path.chmod(0o644)
    assert state_of(capsys, keyed) == {
        "state": "lost",
        "problem": "signing.key.0 is damaged, signing.key.1 is damaged",
        "readable_by_others": ["signing.key.0", "signing.key.1"],
    }
    assert main(["key", "remove", "--state", str(keyed)]) == 0
    assert find_key(stored_key(keyed)).state is KeyState.ABSENT


def test_key_of_another_user_is_unreadable_not_lost(keyed, capsys, monkeypatch):
    def refuse(*_words):
        raise PermissionError(13, "denied")

    monkeypatch.setattr(os, "geteuid", lambda: 54321)
    monkeypatch.setattr("os.read", refuse)
    result = state_of(capsys, keyed)
    assert result["state"] == "unreadable"
    assert result["problem"].startswith(
        "signing.key.0 cannot be read (denied), signing.key.1 cannot be read (denied); run this as"
    )


def test_write_error_is_reported(state, typed, capsys, monkeypatch):
    typed(PASSPHRASE)

    def no_room(*_words):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "pwrite", no_room)
    assert "signing.key cannot be stored" in refused(capsys, "set", "--state", state)
    assert state_of(capsys, state)["state"] == "absent"


@pytest.mark.parametrize(("again", "code"), [("seaworthy", 0), ("seawrothy", 2)])
def test_terminal_asks_for_the_passphrase_twice(again, code, state, capsys, monkeypatch):
    keyboard, terminal = pty.openpty()
    answers, prompts = iter(("seaworthy", again)), []

    def ask(prompt):
        prompts.append(prompt)
        return next(answers)

    with os.fdopen(terminal, encoding="utf-8") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        monkeypatch.setattr("getpass.getpass", ask)
        assert main(["key", "set", "--state", str(state)]) == code
    os.close(keyboard)
    assert prompts == ["Passphrase: ", "Passphrase again: "]
    assert ("the two entries differ" in capsys.readouterr().err) is bool(code)
    assert key_in(state) == (None if code else KEY)
