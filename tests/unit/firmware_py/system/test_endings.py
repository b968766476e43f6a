"""Endings of earlier runs: collected, counted and stored."""

import math
import os
import subprocess
import sys

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.system.endings import (
    ENDED_FILE,
    REASON_FILE,
    TRACEBACK_FILE,
    Ending,
    EndingRecorder,
    Endings,
    collect_endings,
    find_location,
    from_bytes,
    parse_ending,
    to_bytes,
)

MAX_ENDINGS = 20

NOW_S = 1_767_225_600.0


@pytest.mark.parametrize(
    ("line", "reason", "text"),
    [
        ("success exited 0", "stopped", ""),
        ("success exited 10", "shut down", ""),
        ("exit-code exited 10", "shut down", ""),
        ("exit-code exited 11", "stuck", ""),
        ("exit-code exited 2", "failed", "exit code 2"),
        ("signal killed KILL", "killed", "SIGKILL"),
        ("signal killed SEGV", "crashed", "SIGSEGV"),
        ("core-dump dumped ABRT", "crashed", ""),
        ("watchdog killed ABRT", "watchdog", ""),
        ("oom-kill killed KILL", "out of memory", ""),
        ("timeout killed ABRT", "watchdog", ""),
        ("protocol", "failed", ""),
        ("signal killed TERM", "killed", "SIGTERM"),
        (f"exit-code exited {'9' * 21}", "failed", f"exit code {'9' * 20}"),
        (f"signal killed {'X' * 21}", "killed", f"SIG{'X' * 20}"),
    ],
)
def test_each_result_of_the_service_manager_has_a_reason(line, reason, text):
    assert parse_ending(f"1767225500 {line}", NOW_S) == Ending(reason, text, 1767225500.0)


def test_endings_are_collected_once_with_their_reason(tmp_path):
    (tmp_path / ENDED_FILE).write_text("1 exit-code exited 2\n\n2 exit-code exited 11\n")
    (tmp_path / REASON_FILE).write_text("log: nothing done\nfor 15 s")
    assert collect_endings(tmp_path, NOW_S) == (
        Ending("failed", "exit code 2", 1.0),
        Ending("stuck", "log: nothing done for 15 s", 2.0),
    )
    assert collect_endings(tmp_path, NOW_S) == ()
    assert collect_endings(None, NOW_S) == ()
    (tmp_path / ENDED_FILE).write_text("soon\nsoon exit-code exited 3")
    assert collect_endings(tmp_path, NOW_S) == (Ending("failed", "", NOW_S), Ending("failed", "exit code 3", NOW_S))


def test_reason_of_a_run_is_kept_for_an_unexpected_ending(tmp_path, monkeypatch):
    monkeypatch.setattr("firmware_py.system.endings.faulthandler.enable", lambda _file: None)
    for result, ending in (
        ("exit-code exited 2", Ending("failed", "no ?", 1.0)),
        ("success", Ending("stopped", "", 1.0)),
    ):
        recorder = EndingRecorder(tmp_path)
        for text in ("an earlier reason", "no \udcff"):
            recorder.record_reason(text)
        recorder._traceback.close()
        assert (tmp_path / REASON_FILE).stat().st_mode & 0o777 & ~0o640 == 0
        (tmp_path / ENDED_FILE).write_text(f"1 {result}\n")
        assert collect_endings(tmp_path, NOW_S) == (ending,)


def test_link_in_place_of_a_file_of_endings_is_removed(tmp_path):
    (tmp_path / "other").write_text("1 success\n")
    (tmp_path / ENDED_FILE).symlink_to(tmp_path / "other")
    assert collect_endings(tmp_path, NOW_S) == ()
    assert [path.name for path in tmp_path.iterdir()] == ["other"]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can change the owner of a file")
@pytest.mark.parametrize(("owner", "count"), [(0, 1), (4242, 1), (4243, 0)])
def test_only_files_of_root_and_of_the_service_are_read(tmp_path, monkeypatch, owner, count):
    monkeypatch.setattr(os, "geteuid", lambda: 4242)
    (tmp_path / ENDED_FILE).write_text("1 success\n")
    os.chown(tmp_path / ENDED_FILE, owner, -1)
    assert len(collect_endings(tmp_path, NOW_S)) == count


@pytest.mark.parametrize(("size", "count"), [(1 << 16, 1), ((1 << 16) + 1, 0)])
def test_large_file_of_endings_is_ignored_and_removed(tmp_path, size, count):
    (tmp_path / ENDED_FILE).write_bytes(b"1 success\n".ljust(size, b"\n"))
    assert len(collect_endings(tmp_path, NOW_S)) == count
    assert not (tmp_path / ENDED_FILE).exists()


@pytest.mark.parametrize(
    ("is_young", "has_failed", "reasons", "early"),
    [
        (True, False, ("killed",), 3),
        (True, True, (), 3),
        (True, True, ("stopped",), 3),
        (True, False, ("stopped", "shut down", "cut off"), 2),
        (False, False, ("killed",), 0),
    ],
)
def test_consecutive_short_runs_that_failed_are_counted(is_young, has_failed, reasons, early):
    added = tuple(Ending(reason) for reason in reasons)
    endings = Endings(is_young=is_young, failed=has_failed, early=2).with_added(added)
    assert endings == Endings(dict.fromkeys(reasons, 1), added, is_young=is_young, early=early)


C_TRACE = '\nCurrent thread\'s C stack trace (most recent call first):\n  Binary file "/usr/bin/python3", at main+0x3\n'


@pytest.mark.parametrize("suffix", ["", C_TRACE], ids=["Python 3.11 to 3.13", "Python 3.14"])
def test_the_location_is_that_of_the_failed_thread(suffix):
    traceback = (
        'Fatal Python error: Aborted\n\nThread 0x00 (most recent call first):\n  File "/a/b/wait.py", line 1 in other\n'
        "\nCurrent thread 0x00007f5a42db4200 [rambler] (most recent call first):\n"
        f'  File "/opt/firmware_py/core/step.py", line 88 in step\n  File "/opt/loop.py", line 3 in run\n{suffix}'
    )
    assert find_location(traceback) == "in core/step.py:88 step"


def test_after_a_fatal_signal_the_location_is_known(tmp_path):
    script = tmp_path / "folder" / "script.py"
    script.parent.mkdir()
    script.write_text(
        "import os, sys, pathlib\n"
        "from firmware_py.system.endings import EndingRecorder\n"
        "recorder = EndingRecorder(pathlib.Path(sys.argv[1]))\n"
        "def stuck(): os.abort()\n"
        "stuck()\n"
    )
    result = subprocess.run([sys.executable, str(script), str(tmp_path)], check=False)
    assert result.returncode == -6
    (tmp_path / ENDED_FILE).write_text("2 watchdog killed ABRT\n")
    assert collect_endings(tmp_path, NOW_S) == (Ending("watchdog", "in folder/script.py:4 stuck", 2.0),)
    assert not (tmp_path / TRACEBACK_FILE).exists()


@pytest.mark.parametrize("has_directory", [True, False])
def test_a_missing_runtime_directory_is_no_error(tmp_path, has_directory):
    EndingRecorder(tmp_path / "missing" if has_directory else None).record_reason("reason")


def test_new_record_has_a_version_and_no_endings():
    record = {"counts": {}, "last": [], "running": False, "is_young": False, "failed": False, "early": 0, "version": 1}
    assert msgspec.msgpack.decode(to_bytes(Endings())) == record
    assert Ending("killed") == Ending("killed", "", 0.0)


def test_endings_are_counted_and_the_last_ones_stored():
    endings = Endings()
    for count in range(MAX_ENDINGS + 5):
        endings = endings.with_added((Ending("killed", "", float(count)),))
    assert endings.counts == {"killed": MAX_ENDINGS + 5}
    assert [ending.utc_s for ending in endings.last] == [float(count) for count in range(5, MAX_ENDINGS + 5)]
    assert from_bytes(to_bytes(endings)) == (endings, ())


@given(st.binary(max_size=200))
def test_any_bytes_are_endings_or_refused(content):
    try:
        assert isinstance(from_bytes(content)[0], Endings)
    except ValueError:
        pass


@pytest.mark.parametrize("content", [b"", b"{}", b'{"counts":{},"last":[],"running":false}\n', b"\x93", b"\xc0"])
def test_invalid_records_are_refused(content):
    with pytest.raises(ValueError):
        from_bytes(content)


def test_texts_times_and_numbers_of_endings_are_limited():
    endings = Endings(last=(Ending("killed", "x" * 1000, math.nan),) * (MAX_ENDINGS + 1))
    assert from_bytes(to_bytes(endings)) == (Endings(last=(Ending("killed", "x" * 160, 0.0),) * MAX_ENDINGS), ())
    endings = Endings({f"{n:02d}": 10**9 + n - 10 for n in range(21)}, (Ending("a\nb\x1b"),), early=2 * 10**9)
    counts = {f"{n:02d}": min(10**9 + n - 10, 10**9) for n in range(20)}
    assert from_bytes(to_bytes(endings))[0] == Endings(counts, (Ending("a b\\x1b"),), early=10**9)
    assert from_bytes(to_bytes(Endings({"killed": -1}, early=-1)))[0] == Endings({"killed": 0})
