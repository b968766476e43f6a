"""How the runs before have ended: read from what they left, counted, kept."""

import math
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.system.endings import (
    ENDED_FILE,
    MAX_ENDINGS,
    REASON_FILE,
    TRACEBACK_FILE,
    Ending,
    EndingRecorder,
    Endings,
    collect_endings,
    ending_of,
    from_bytes,
    location_of,
    to_bytes,
)

NOW_S = 1_767_225_600.0


@pytest.mark.parametrize(
    ("line", "why", "text"),
    [
        ("1767225500 success exited 0", "stopped", ""),
        ("1767225500 success exited 10", "shut down", ""),
        ("1767225500 exit-code exited 10", "shut down", ""),
        ("1767225500 exit-code exited 11", "stuck", ""),
        ("1767225500 exit-code exited 2", "failed", "exit code 2"),
        ("1767225500 signal killed KILL", "killed", "SIGKILL"),
        ("1767225500 signal killed SEGV", "crashed", "SIGSEGV"),
        ("1767225500 core-dump dumped ABRT", "crashed", ""),
        ("1767225500 watchdog killed ABRT", "watchdog", ""),
        ("1767225500 oom-kill killed KILL", "out of memory", ""),
        ("1767225500 timeout killed ABRT", "watchdog", ""),
        ("1767225500 protocol", "failed", ""),
    ],
)
def test_each_result_of_the_service_manager_has_a_reason(line, why, text):
    assert ending_of(line, NOW_S) == Ending(why, text, 1767225500.0)


def test_endings_are_collected_once_with_their_reason(tmp_path):
    (tmp_path / ENDED_FILE).write_text("1 exit-code exited 2\n\n2 exit-code exited 11\n")
    (tmp_path / REASON_FILE).write_text("log: nothing done\nfor 15 s")
    assert collect_endings(tmp_path, NOW_S) == (
        Ending("failed", "exit code 2", 1.0),
        Ending("stuck", "log: nothing done for 15 s", 2.0),
    )
    assert collect_endings(tmp_path, NOW_S) == ()
    assert collect_endings(None, NOW_S) == ()


@pytest.mark.parametrize(
    "more",
    [
        "",
        '\nCurrent thread\'s C stack trace (most recent call first):\n  Binary file "/usr/bin/python3", at main+0x3\n',
    ],
    ids=["Python 3.11 to 3.13", "Python 3.14"],
)
def test_the_location_is_that_of_the_loop_s_thread_for_each_python(more):
    traceback = (
        'Fatal Python error: Aborted\n\nThread 0x00 (most recent call first):\n  File "/a/b/wait.py", line 1 in other\n'
        "\nCurrent thread 0x00007f5a42db4200 [rambler] (most recent call first):\n"
        f'  File "/opt/firmware_py/core/step.py", line 88 in step\n  File "/opt/loop.py", line 3 in run\n{more}'
    )
    assert location_of(traceback) == "in core/step.py:88 step"


def test_a_fatal_signal_leaves_the_location(tmp_path):
    program = (
        "import os, sys, pathlib\n"
        "from firmware_py.system.endings import EndingRecorder\n"
        "watcher = EndingRecorder(pathlib.Path(sys.argv[1]))\n"
        "def stuck(): os.abort()\n"
        "stuck()\n"
    )
    (tmp_path / "place").mkdir()
    script = tmp_path / "place" / "script.py"
    script.write_text(program)
    done = subprocess.run([sys.executable, str(script), str(tmp_path)], check=False)
    assert done.returncode == -6
    (tmp_path / ENDED_FILE).write_text("2 watchdog killed ABRT\n")
    assert collect_endings(tmp_path, NOW_S) == (Ending("watchdog", "in place/script.py:4 stuck", 2.0),)
    assert not (tmp_path / TRACEBACK_FILE).exists()


def test_an_unwritable_directory_is_ignored(tmp_path):
    watcher = EndingRecorder(tmp_path / "missing")
    watcher.record_reason("why")
    EndingRecorder(None).record_reason("why")


def test_they_are_counted_and_the_last_ones_kept():
    endings = Endings()
    for count in range(MAX_ENDINGS + 5):
        endings = endings.with_added((Ending("killed", "", float(count)),))
    assert endings.counts == {"killed": MAX_ENDINGS + 5}
    assert [ending.utc_s for ending in endings.last] == [float(count) for count in range(5, MAX_ENDINGS + 5)]
    assert from_bytes(to_bytes(endings)) == (endings, ())


@given(st.binary(max_size=200))
def test_whatever_is_stored_is_endings_or_no_record(content):
    try:
        assert isinstance(from_bytes(content)[0], Endings)
    except ValueError:
        pass


@pytest.mark.parametrize("content", [b"", b"{}", b'{"counts":{},"last":[],"running":false}\n', b"\x93", b"\xc0"])
def test_invalid_records_are_refused(content):
    with pytest.raises(ValueError):
        from_bytes(content)


def test_a_time_that_is_not_finite_and_a_long_text_are_bounded():
    endings = Endings(last=(Ending("killed", "x" * 1000, math.nan),) * (MAX_ENDINGS + 1))
    assert from_bytes(to_bytes(endings)) == (Endings(last=(Ending("killed", "x" * 160, 0.0),) * MAX_ENDINGS), ())
