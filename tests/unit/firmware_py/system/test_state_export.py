"""Exports of the state: round trip, damaged heads, and limits of their parts."""

import hashlib
import json
import os

import pytest

from firmware_py.system.state_export import (
    BrokenExportError,
    Export,
    begin_import,
    end_import,
    pack,
    pending_import,
    unpack,
)

EXPORT = Export({"a.param": "CTL_K1 3 \u00e9\n".encode(), "b.record": b"\x00\xff", "c.plan": None}, {"boat": "x"})


def export_of(files, about=None, *, number=2, length=None):
    body = json.dumps({"about": about or {}, "files": files}).encode()
    size = len(body) if length is None else length
    return f"# rambler exported state {number} {size} {hashlib.sha256(body).hexdigest()}\n".encode() + body


def refusal(data):
    with pytest.raises(BrokenExportError) as error:
        unpack(data)
    return str(error.value)


def test_export_is_read_back():
    assert pack(EXPORT).startswith(b"# rambler exported state 2 ")
    assert unpack(pack(EXPORT)) == EXPORT
    assert [EXPORT.content(name) for name in ("b.record", "c.plan", "none")] == [b"\x00\xff", None, None]


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (export_of({}, number=1), "has format 1, this version reads 2; export that state with this version"),
        (export_of({}, number=3), "has format 3, this version reads 2; use a newer version"),
        (export_of({}, length=3), "is damaged"),
        (export_of({}) + b"\n", "is damaged"),
        (export_of({}).replace(b"about", b"abouT"), "is damaged"),
        (b"# rambler exported state x", "is damaged"),
        (b"text", "is not an exported state of rambler"),
        (
            export_of({"x" * 33 + ".plan": ""}),
            f"is not an exported state of rambler: '{'x' * 33}.plan' is not a valid name",
        ),
        (export_of({"x" * 50: ""}), f"is not an exported state of rambler: '{'x' * 40}' is not a valid name"),
        (export_of({"a.record": "*"}), "is not an exported state of rambler: Only base64 data is allowed"),
    ],
)
def test_damaged_or_other_file_is_refused(data, text):
    assert refusal(data) == text


@pytest.mark.parametrize(("name", "slot_bytes"), [("a.key", 1 << 16), ("a.plan", 1 << 22), ("a.param", 1 << 20)])
def test_content_must_fit_into_a_slot_with_its_head(name, slot_bytes):
    content = "x" * (slot_bytes - 64)
    assert unpack(export_of({name: content})).files == {name: content.encode()}
    assert refusal(export_of({name: content + "x"})).endswith(f"{name} is larger than {slot_bytes >> 10} KiB")


def test_description_and_texts_of_errors_are_limited():
    about = {f"{number}{'k' * 200}": "v" * 201 for number in range(9)}
    expected = {f"{number}{'k' * 199}": "v" * 200 for number in range(8)}
    assert unpack(export_of({}, about)).about == expected
    assert len(refusal(export_of({"a.param": ["x" * 300]})).partition(": ")[2]) <= 200


def test_import_is_pending_until_it_ends(tmp_path):
    assert pending_import(tmp_path) is None
    begin_import(tmp_path, EXPORT)
    assert (tmp_path / "import.awaited").stat().st_mode & 0o777 == 0o600
    assert pending_import(tmp_path) == EXPORT
    end_import(tmp_path)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "other").write_bytes(pack(EXPORT))
    (tmp_path / "import.awaited").symlink_to(tmp_path / "other")
    with pytest.raises(BrokenExportError, match=r"^import\.awaited is a symbolic link, not a regular file$"):
        pending_import(tmp_path)


@pytest.mark.parametrize("can_remove", [True, False])
def test_import_that_may_be_incomplete_is_removed_or_reported(tmp_path, monkeypatch, can_remove):
    def fail_after_writing(path, content, _mode):
        path.write_bytes(content)
        raise OSError(5, "Input/output error")

    def fail(_path):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("firmware_py.system.state_export.write_atomically", fail_after_writing)
    if not can_remove:
        monkeypatch.setattr(os, "unlink", fail)
    text = "Input/output error" + ("" if can_remove else "; the next start may find it nevertheless")
    with pytest.raises(OSError, match=f"{text}$"):
        begin_import(tmp_path, EXPORT)
    assert (tmp_path / "import.awaited").exists() is not can_remove


def test_secrets_of_an_ended_import_are_overwritten(tmp_path, monkeypatch):
    begin_import(tmp_path, EXPORT)
    monkeypatch.setattr(os, "unlink", lambda _path: None)
    end_import(tmp_path)
    (path,) = tmp_path.iterdir()
    assert path.read_bytes() == bytes(len(pack(EXPORT)))
