"""Update: a bundle is unpacked into a new environment, checked, and installed on trial by one rename.

After an interruption at any step (kill, full disk, power cut) the service finds a program that can be started: the
previous one before the rename, the new one after it, and the previous one again after a failed trial (program_link.py).
"""

from __future__ import annotations

import fcntl
import os
import shlex
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from firmware_py import ROOT, __version__, commit_of, commit_utc_s_of
from firmware_py.files.reading import read_regular
from firmware_py.install import environment as environments
from firmware_py.install.bundle import Bundle, UpdateError, check_computer, is_older, title_text, unpack
from firmware_py.install.environment import Environment, environment_of
from firmware_py.install.program_link import STARTS, TRIAL_S, UPDATE_FILE, ProgramLink, passed_text
from firmware_py.install.self_check import Candidate, printed_unit, self_check
from firmware_py.install.unit import Installation
from firmware_py.system.clock import machine_s
from firmware_py.system.state_directory import StateFiles
from firmware_py.system.status_file import FoundStatus, Freshness, find

SIGNERS = Path("/etc/rambler/allowed_signers")
_POLL_S, _START_S = 1.0, 90.0
_MAX_SLOT_BYTES = 1 << 18
_UMASK = 0o022  # the service user reads and runs files installed by root
Say = Callable[[str], None]


class Permissions(msgspec.Struct, frozen=True):
    """Exceptions allowed by the operator: update while armed, or to an older version."""

    armed: bool = False
    older: bool = False


def update(installation: Installation, bundle_file: Path, signers: Path | None, may: Permissions, say: Say) -> None:
    """Install a bundle on trial; raise UpdateError on failure, with nothing changed."""
    with _locked(installation.link, installation.state) as (link, current, lock):
        _check_unarmed(installation.state, may)
        work = environments.work_directory(current)
        try:
            bundle = unpack(bundle_file, work / "wheels", signers)
            trust = "signed" if signers is not None else "hashes correct, signature not required"
            say(f"{bundle_file.name}: {bundle.title}, {trust}")
            check_computer(bundle)
            _check_age(bundle, current, may, say)
            new = environments.environment_for(current, bundle)
            if new == current:
                raise UpdateError(f"{bundle.title} is already installed")
            before = link.before()
            kept = [current, *([Environment(before.parents[1])] if before is not None else []), new]
            for name in environments.remove_others(kept):
                say(f"removed {name} of an earlier update")
            try:
                if new.bundle() != bundle:
                    environments.check_room(new, work / "wheels")
                    say(f"creating {new.path}: takes some minutes on a slow board")
                    environments.make(new, work / "wheels", bundle, lock)
                for line in self_check(Candidate(new, bundle, installation.vehicle, installation.state, work)):
                    say(line)
            except BaseException:
                if new not in kept[:-1]:
                    environments.remove_others(kept[:-1])  # frees the space
                raise
        finally:
            shutil.rmtree(work, ignore_errors=True)
        _switch(installation, link, new, may, say)
        _compare_units(installation, new, say)


def roll_back(installation: Installation, may: Permissions, say: Say) -> None:
    """Install the previous version again, on trial; raise UpdateError without one."""
    with _locked(installation.link) as (link, current, _lock):
        before = link.before()
        if before is None or before == current.program:
            raise UpdateError("there is no previous version")
        if not os.access(before, os.X_OK):
            raise UpdateError(f"{before} no longer exists; update with a bundle of that version (--older)")
        _switch(installation, link, Environment(before.parents[1]), may, say)
        _compare_units(installation, Environment(before.parents[1]), say)


def await_trial(installation: Installation, say: Say) -> bool:
    """Wait for the end of the trial; return whether the new program stays."""
    link = installation.link
    program, starts = link.target(), 0
    timeout_s = time.monotonic() + STARTS * (TRIAL_S + _START_S)
    while time.monotonic() < timeout_s:
        if (failed := link.failed()) is not None:
            say(f"rolled back: {failed.name} has not passed its trial in {failed.starts} starts")
            return False
        if program is not None and StateFiles(installation.state).load(UPDATE_FILE) == passed_text(program).encode():
            link.end_trial()
            say("trial passed: the new version stays")
            return True
        trial = link.trial()
        if trial is None:
            say("trial passed before: the version stays")
            return True
        if trial.starts != starts:
            starts = trial.starts
            say(f"start {starts} of {STARTS}; passes after {TRIAL_S:.0f} s")
        time.sleep(_POLL_S)
    say("trial not finished; the next starts decide, see rambler status")
    return False


@contextmanager
def _locked(link: ProgramLink, state: Path | None = None) -> Iterator[tuple[ProgramLink, Environment, int]]:
    """Lock out other updates; raise UpdateError if none is possible, or with a state directory during a trial."""
    folder = link.path.parent
    before_umask = os.umask(_UMASK)
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        program = link.target()
        if program is None:
            raise UpdateError(
                f"{link.path} is not a link; replace it by a link to the program (ln -s), and repeat "
                "rambler service install VEHICLE.toml by that name"
            )
        current = environment_of(program)
        for directory in (folder, current.path.parent):
            if not os.access(directory, os.W_OK):
                raise UpdateError(f"{directory} is not writable; run this as root (sudo), and mount it for writing")
        if state is not None and (trial := link.trial()) is not None and not _has_passed(state, trial.program):
            raise UpdateError(
                f"{trial.name} is on trial ({trial.starts} starts so far); wait until it has passed, "
                "or use rambler update --back"
            )
        yield link, current, descriptor
    except BlockingIOError:
        raise UpdateError("another update is running; wait for its end") from None
    finally:
        os.close(descriptor)
        os.umask(before_umask)


def _check_age(bundle: Bundle, current: Environment, may: Permissions, say: Say) -> None:
    present = current.bundle()
    if not is_older(bundle, __version__, commit_utc_s_of(ROOT) if present is None else present.commit_utc_s):
        return
    title = title_text(__version__, commit_of(ROOT)) if present is None else present.title
    text = f"{bundle.title} is older than the installed {title}"
    if not may.older:
        raise UpdateError(f"{text}; to allow a downgrade, use --older")
    say(text)


def _check_unarmed(state: Path, may: Permissions) -> FoundStatus:
    """Return the status; raise UpdateError if the boat is armed or its arming state is unknown, unless allowed."""
    found = find(state, machine_s())
    if may.armed or (found.freshness is Freshness.ABSENT and not found.is_refused):
        return found
    if found.freshness is not Freshness.RUNNING or "armed" not in found.content:
        raise UpdateError(f"arming state unknown ({found.reason}); to update anyway, use --armed")
    if found.content["armed"]:
        raise UpdateError("the boat is armed; disarm it, or use --armed (the rudder is centred during the restart)")
    return found


def _switch(installation: Installation, link: ProgramLink, new: Environment, may: Permissions, say: Say) -> None:
    """Install a program and end the running one, so that the service starts the new one."""
    found = _check_unarmed(installation.state, may)
    link.switch(new.program)
    passed = _has_passed(installation.state, new.program)
    say(f"{link.path} points to {new.program}{'' if passed else f', on trial for {STARTS} starts'}")
    pid = int(found.content.get("pid", 0))
    if found.freshness is Freshness.ABSENT or not _is_autopilot(pid, link.path):
        say("no autopilot runs; the next start of the service uses it (sudo systemctl start rambler); waiting")
        return
    os.kill(pid, signal.SIGTERM)
    say(f"process {pid} ended; the service starts the new one")


def _has_passed(state: Path, program: Path) -> bool:
    """Return whether a program has passed a trial, by the same record as the start script."""
    line = passed_text(program).encode().rstrip(b"\n")
    for slot in state.glob(f"{UPDATE_FILE}.[01]"):
        with suppress(OSError, ValueError):
            if line in read_regular(slot, _MAX_SLOT_BYTES, follow=False).split(b"\n"):
                return True
    return False


def _compare_units(installation: Installation, new: Environment, say: Say) -> None:
    """Report if the new version has another unit than the installed one, which still works."""
    unit = printed_unit(new.program, [*installation.service_words, "--program", str(installation.link.path)])
    if unit is not None and unit != installation.unit:
        again = shlex.join(["rambler", "service", "install", *installation.service_words])
        say(f"the new version has another service unit; after the trial: sudo {again}")


def _is_autopilot(pid: int, program: Path) -> bool:
    """Return whether a process is an autopilot started by the link; the pid in a status may be forged."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return False
    return os.fsencode(program) in words and b"run" in words
