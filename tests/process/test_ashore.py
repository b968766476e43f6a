"""The autopilot with an unwritable disk, or short of memory, descriptors or threads."""

import contextlib
import json
import os
import pty
import resource
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from firmware_py.__main__ import main
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.log.reader import LogReader
from firmware_py.system.slots import stored_content
from firmware_py.system.store import Store
from support.paths import ROOT
from support.program import Program

VEHICLE = """
[compass]
driver = "nmea"
port = "{}"
baud = 4800
[rudder]
driver = "volz"
port = "{}"
baud = 115200
"""
UNPRIVILEGED_USER = 65534
# Root may write anywhere: the program changes its user, but after the imports, as others may not read root's Python.
AS_UNPRIVILEGED_USER = f"""
import gettext, locale, os, resource, shutil, subprocess, sys, traceback
import firmware_py.cli.run
from firmware_py.__main__ import main
if not os.geteuid():
    os.setgroups([]), os.setgid({UNPRIVILEGED_USER}), os.setuid({UNPRIVILEGED_USER})
sys.exit(main(sys.argv[1:]))
"""
PLAIN = ["-m", "firmware_py"]
# As root the tests start programs of another user, who must be able to read the checkout: not one in /root.
needs_readable_checkout = pytest.mark.skipif(
    os.geteuid() == 0 and not all(path.stat().st_mode & 0o001 for path in (ROOT, *ROOT.parents)),
    reason="other users cannot read this checkout",
)
MISSION = plan_to_text(Plan.of(PlanKind.MISSION, (PlanItem(16, 3, x=1, y=2),))).encode()


@pytest.fixture
def place():
    """A directory that anybody may enter."""
    directory = Path(tempfile.mkdtemp())
    directory.chmod(0o755)
    yield directory
    shutil.rmtree(directory)


@pytest.fixture
def vehicle(place):
    """A vehicle file with ports that are there."""
    ends = [pty.openpty() for _ in range(2)]
    ports = [os.ttyname(slave) for _, slave in ends]
    for port in ports:
        Path(port).chmod(0o666)
    path = place / "boat.toml"
    path.write_text(VEHICLE.format(*ports))
    yield path
    for descriptor in (end for pair in ends for end in pair):
        os.close(descriptor)


@contextlib.contextmanager
def started(vehicle, tmp_path, *more, how=PLAIN):
    program = Program("rambler", [sys.executable, *how, "run", str(vehicle), *map(str, more)], tmp_path)
    try:
        yield program
        program.send_signal(signal.SIGTERM)
        assert program.exit_code() == 0
    finally:
        program.close()


def refused(vehicle, *more, how=PLAIN, limit=None):
    """Run until its end; return its one line."""
    done = subprocess.run(
        [sys.executable, *how, "run", str(vehicle), *map(str, more)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60.0,
        preexec_fn=limit,
        check=False,
    )
    (line,) = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (2, "")
    return line


def filled(directory):
    """Leave what an earlier run has: a parameter and a mission."""
    store = Store(directory)
    store.save("parameters.param", b"CTL_K1 33\n")
    store.save("mission.plan", MISSION)
    store.close()
    for path in directory.iterdir():
        path.chmod(0o644)
    directory.chmod(0o755)


def parameters_in_log(directory):
    (log,) = (directory / "logs").glob("*.BIN")
    first = next(iter(LogReader(log)))
    return first.checkpoint


@needs_readable_checkout
def test_the_autopilot_starts_without_a_writable_state_directory(place, vehicle, tmp_path, capsys):
    state = place / "state"
    filled(state)
    how = ["-c", AS_UNPRIVILEGED_USER]
    line = refused(vehicle, "--state", state, how=how)
    assert line == f"rambler run: state directory {state}: Permission denied; choose another with --state"
    with started(vehicle, tmp_path, "--state", state, "--wait", how=how) as program:
        program.expect(f"state directory {state}: Permission denied")
        program.expect("Loaded from storage: 1 parameters, mission of 1 items, fence of 0 items")
        program.expect("Storage error: logs or settings not saved")
        assert not (state / "logs").exists()

        # Where the state directory is another user's, a status of that boat could be anybody's.
        main(["status", "--state", str(state), "--json"])
        status = json.loads(capsys.readouterr().out)
        assert (status["status"] == "running") == (os.geteuid() != 0)
        for path in (state, *state.iterdir()):
            path.chmod(0o777)
        program.expect("Storage error cleared")
    assert b"CTL_K1 33\nSTAT_BOOTCNT 1\n" in stored_content(state, "parameters.param")
    assert '"CTL_K1":33.0' in parameters_in_log(state)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may write what belongs to others")
def test_root_does_not_write_the_state_of_another_user(place, vehicle):
    """What root wrote there, parameters among it, the service's next start could not read."""
    state = place / "state"
    filled(state)
    os.chown(state, UNPRIVILEGED_USER, UNPRIVILEGED_USER)
    before = sorted(state.iterdir())
    line = refused(vehicle, "--state", state)
    assert line.startswith(f"rambler run: state directory {state} belongs to user ")
    assert "run this as that user" in line
    assert sorted(state.iterdir()) == before


@needs_readable_checkout
def test_an_unreadable_state_is_reported_and_the_vehicle_file_applies(place, vehicle, tmp_path):
    state = place / "state"
    filled(state)
    state.chmod(0o700)
    with started(vehicle, tmp_path, "--state", state, "--wait", how=["-c", AS_UNPRIVILEGED_USER]) as program:
        if os.geteuid():
            return  # it is our own
        program.expect(r"parameters.param.0 cannot be read \(Permission denied\)")
        program.expect("Loaded from storage: 0 parameters, mission of 0 items")
        program.expect("Storage error: logs")


def test_a_state_directory_that_appears_late_is_used_with_its_content(place, vehicle, tmp_path):
    filled(place / "medium")
    (place / "mount").touch()  # a path through a file: what root may not do either
    line = refused(vehicle, "--state", place / "mount" / "state")
    assert "Not a directory; choose another with --state" in line
    with started(vehicle, tmp_path, "--state", place / "mount" / "state", "--wait") as program:
        program.expect("Loaded from storage: 0 parameters")
        program.expect("Storage error: logs")
        (place / "mount").unlink()
        (place / "mount").mkdir()
        (place / "medium").rename(place / "mount" / "state")
        program.expect("State directory mounted: its content is used from the next start")
        program.expect("Storage error cleared")
    assert b"CTL_K1 33\nSTAT_BOOTCNT 1\n" in stored_content(place / "mount" / "state", "parameters.param")
    assert stored_content(place / "mount" / "state", "mission.plan") == MISSION


@pytest.mark.parametrize("umask", [pytest.param(0o000, marks=pytest.mark.proof), 0o077])
def test_files_are_made_for_owner_and_group_whatever_the_umask(umask, place, vehicle, tmp_path):
    state = place / "new" / "state"
    before = os.umask(umask)
    try:
        with started(vehicle, tmp_path, "--state", state) as program:
            program.wait_for(lambda: list(state.glob("logs/thin/*.BIN")), "no log")
    finally:
        os.umask(before)
    made = (state.parent, state, *state.rglob("*"))
    modes = {str(path.relative_to(place)): stat.S_IMODE(path.stat().st_mode) for path in made}
    assert modes == {
        "new": 0o750,
        "new/state": 0o750,
        "new/state/lock": 0o640,
        "new/state/endings.record.0": 0o640,
        "new/state/endings.record.1": 0o640,
        "new/state/parameters.param.0": 0o640,
        "new/state/logs": 0o750,
        "new/state/logs/00000001.BIN": 0o640,
        "new/state/logs/thin": 0o750,
        "new/state/logs/thin/00000001.BIN": 0o640,
    }


def limits(kind, value):
    return lambda: resource.setrlimit(kind, (value, value))


@pytest.mark.parametrize("count", [9, pytest.param(14, marks=pytest.mark.proof)])
def test_too_few_descriptors_are_one_line(count, place, vehicle):
    line = refused(vehicle, "--state", place / "state", limit=limits(resource.RLIMIT_NOFILE, count))
    assert "oo many open files" in line


@pytest.mark.parametrize("megabytes", [48, 76, 100])
def test_too_little_memory_is_one_line(place, vehicle, megabytes):
    """From 62 to 94 MB it is numpy's library that finds too little, and would end the process in its own way."""
    line = refused(vehicle, "--state", place / "state", limit=limits(resource.RLIMIT_AS, megabytes << 20))
    assert "out of memory" in line


@needs_readable_checkout
def test_no_thread_is_one_line(place, vehicle):
    place.chmod(0o777)
    alone = "resource.setrlimit(resource.RLIMIT_NPROC, (1, 1))\nsys.exit"
    line = refused(vehicle, "--state", place / "state", how=["-c", AS_UNPRIVILEGED_USER.replace("sys.exit", alone)])
    assert "cannot start a thread" in line


@needs_readable_checkout
def test_twenty_two_descriptors_are_enough_and_too_few_for_many_links(place, vehicle, tmp_path):
    links = [word for port in range(20) for word in ("--link", f"udpout:127.0.0.1:{40000 + port}")]
    limit = limits(resource.RLIMIT_NOFILE, 22)
    assert "oo many open files" in refused(vehicle, "--state", place / "state", *links, limit=limit)
    how = ["-c", "import resource\nresource.setrlimit(resource.RLIMIT_NOFILE, (22, 22))\n" + AS_UNPRIVILEGED_USER]
    place.chmod(0o777)
    with started(vehicle, tmp_path, "--state", place / "state" / "another", "--wait", how=how) as program:
        program.expect("Mode HOLD")
