"""An update: a bundle becomes an environment beside the one in force, is checked, and put in force by one rename.

It is on trial then. Whatever ends an update, be it a kill between any two of its steps, a full disk or a power cut, the
service finds a program that can be started: the one before until the rename, the new one after it, and the one before
again when the new one does not pass its trial (program_link.py).
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
_LOOK_S, _START_S = 1.0, 90.0
_MOST_SLOT_BYTES = 1 << 18
_UMASK = 0o022  # the service's user reads and runs what root installs
Say = Callable[[str], None]


class Permissions(msgspec.Struct, frozen=True):
    """What the operator has said may be: an update of an armed boat, or to an older version."""

    armed: bool = False
    older: bool = False


def update(installation: Installation, bundle_file: Path, signers: Path | None, may: Permissions, say: Say) -> None:
    """Put what a bundle holds in force, on trial; UpdateError when it cannot be, and then nothing has changed."""
    with _held(installation.link, installation.state) as (link, current, lock):
        _check_unarmed(installation.state, may)
        work = environments.work_directory(current)
        try:
            bundle = unpack(bundle_file, work / "wheels", signers)
            trust = "signed" if signers is not None else "whole; no signature was asked for"
            say(f"{bundle_file.name}: {bundle.title}, {trust}")
            check_computer(bundle)
            _check_age(bundle, current, may, say)
            new = environments.beside(current, bundle)
            if new == current:
                raise UpdateError(f"{bundle.title} is in force already")
            before = link.before()
            kept = [current, *([Environment(before.parents[1])] if before is not None else []), new]
            for name in environments.remove_others(kept):
                say(f"removed {name}, of an earlier update")
            try:
                if new.bundle() != bundle:
                    environments.check_room(new, work / "wheels")
                    say(f"making {new.path}: some minutes on a slow board")
                    environments.make(new, work / "wheels", bundle, lock)
                for line in self_check(Candidate(new, bundle, installation.vehicle, installation.state, work)):
                    say(line)
            except BaseException:
                if new not in kept[:-1]:
                    environments.remove_others(kept[:-1])  # it would only take room
                raise
        finally:
            shutil.rmtree(work, ignore_errors=True)
        _switch(installation, link, new, may, say)
        _compare_units(installation, new, say)


def go_back(installation: Installation, may: Permissions, say: Say) -> None:
    """Put the program of before in force again, on trial; UpdateError when there is none."""
    with _held(installation.link) as (link, current, _lock):
        before = link.before()
        if before is None or before == current.program:
            raise UpdateError("there is no version before this one")
        if not os.access(before, os.X_OK):
            raise UpdateError(f"{before} is not there any more; update to a bundle of that version (--older)")
        _switch(installation, link, Environment(before.parents[1]), may, say)
        _compare_units(installation, Environment(before.parents[1]), say)


def await_trial(installation: Installation, say: Say) -> bool:
    """Look on until the trial is over; return whether the new program stays."""
    link = installation.link
    program, starts = link.target(), 0
    give_up_s = time.monotonic() + STARTS * (TRIAL_S + _START_S)
    while time.monotonic() < give_up_s:
        if (failed := link.failed()) is not None:
            say(f"taken back: {failed.name} was started {failed.starts} times and has not passed its trial")
            return False
        if program is not None and StateFiles(installation.state).load(UPDATE_FILE) == passed_text(program).encode():
            link.end_trial()
            say("passed: it stays")
            return True
        trial = link.trial()
        if trial is None:
            say("it has passed a trial before: it stays")
            return True
        if trial.starts != starts:
            starts = trial.starts
            say(f"start {starts} of {STARTS}; it has passed when it has run for {TRIAL_S:.0f} s")
        time.sleep(_LOOK_S)
    say("the trial is not over; its next starts decide, look again by rambler status")
    return False


@contextmanager
def _held(link: ProgramLink, state: Path | None = None) -> Iterator[tuple[ProgramLink, Environment, int]]:
    """Keep other updates out, and look whether there may be one at all: with a state not while one is on trial."""
    folder = link.path.parent
    before_umask = os.umask(_UMASK)
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        program = link.target()
        if program is None:
            raise UpdateError(
                f"{link.path} is no link that could lead elsewhere: make it one to the program (ln -s), and repeat "
                "rambler service install VEHICLE.toml by that name"
            )
        current = environment_of(program)
        for place in (folder, current.path.parent):
            if not os.access(place, os.W_OK):
                raise UpdateError(f"{place} may not be written: be root (sudo), and mount it for writing")
        if state is not None and (trial := link.trial()) is not None and not _has_passed(state, trial.program):
            raise UpdateError(
                f"{trial.name} is on trial ({trial.starts} starts so far): wait until it has "
                "passed, or rambler update --back"
            )
        yield link, current, descriptor
    except BlockingIOError:
        raise UpdateError("another update is under way; wait for its end") from None
    finally:
        os.close(descriptor)
        os.umask(before_umask)


def _check_age(bundle: Bundle, current: Environment, may: Permissions, say: Say) -> None:
    ours = current.bundle()
    if not is_older(bundle, __version__, commit_utc_s_of(ROOT) if ours is None else ours.commit_utc_s):
        return
    title = title_text(__version__, commit_of(ROOT)) if ours is None else ours.title
    text = f"{bundle.title} is older than {title}, which is in force"
    if not may.older:
        raise UpdateError(f"{text}; to go back to it all the same, --older")
    say(text)


def _check_unarmed(state: Path, may: Permissions) -> FoundStatus:
    """Raise UpdateError when she is armed, or does not say whether she is, unless that may be; return her status."""
    found = find(state, machine_s())
    if may.armed or (found.freshness is Freshness.ABSENT and not found.is_refused):
        return found
    if found.freshness is not Freshness.RUNNING or "armed" not in found.content:
        raise UpdateError(
            f"what runs does not say whether she is armed ({found.reason}); --armed to go on all the same"
        )
    if found.content["armed"]:
        raise UpdateError("she is armed: disarm her, or --armed; the rudder goes amidships for the restart")
    return found


def _switch(installation: Installation, link: ProgramLink, new: Environment, may: Permissions, say: Say) -> None:
    """Put a program in force and end the one that runs, so that the service starts the new one."""
    found = _check_unarmed(installation.state, may)
    link.switch(new.program)
    passed = _has_passed(installation.state, new.program)
    say(f"{link.path} leads to {new.program}{'' if passed else f', on trial for {STARTS} starts'}")
    pid = int(found.content.get("pid", 0))
    if found.freshness is Freshness.ABSENT or not _is_ours(pid, link.path):
        say("nothing runs on its state: the service's next start takes it (sudo systemctl start rambler); looking on")
        return
    os.kill(pid, signal.SIGTERM)
    say(f"process {pid} was told to end; the service starts the new one")


def _has_passed(state: Path, program: Path) -> bool:
    """Whether a program has passed a trial as far as is kept; the service's next start looks the same way."""
    line = passed_text(program).encode().rstrip(b"\n")
    for slot in state.glob(f"{UPDATE_FILE}.[01]"):
        with suppress(OSError, ValueError):
            if line in read_regular(slot, _MOST_SLOT_BYTES, follow=False).split(b"\n"):
                return True
    return False


def _compare_units(installation: Installation, new: Environment, say: Say) -> None:
    """Say so when a version wants to be run by another unit than the one that is installed; this one still runs it."""
    unit = printed_unit(new.program, [*installation.service_words, "--program", str(installation.link.path)])
    if unit is not None and unit != installation.unit:
        again = shlex.join(["rambler", "service", "install", *installation.service_words])
        say(f"its unit is another one than that which is installed: when it has passed, sudo {again}")


def _is_ours(pid: int, program: Path) -> bool:
    """Whether a process is an autopilot of the link: anybody may have written its number into a status."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return False
    return os.fsencode(program) in words and b"run" in words
