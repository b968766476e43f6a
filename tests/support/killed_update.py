"""Updates of a small tree of programs, each ended at a different step, in a child process for each step.

A step is before each change of the disk by Python (audit events: opened for writing, created, renamed, linked, removed,
program started), and at the first execution of each line of the update modules, when written data may not be flushed.
`kill` ends the child at the step by SIGKILL; with `full` the disk is full from this change on.
"""

import errno
import itertools
import json
import os
import shutil
import signal
import stat
import sys
from pathlib import Path

from firmware_py.install import environment, program_link, self_check, update
from firmware_py.install.bundle import UpdateError
from firmware_py.install.program_link import ProgramLink
from firmware_py.install.service_files import Service, build_trial_script, build_unit
from firmware_py.install.unit import Installation
from firmware_py.install.update import Permissions

CHANGES = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.symlink", "os.chmod", "subprocess.Popen")
FILLING = ("open", "os.mkdir", "os.symlink", "os.rename", "subprocess.Popen")  # changes that need space
WRITING = os.O_WRONLY | os.O_RDWR
TRACED = tuple(module.__file__ for module in (environment, program_link, self_check, update))
PROGRAM = '#!/bin/sh\necho "steers {version}"\nexit {code}\n'


def build(words, _held):
    """Replacement of venv and pip: create their tree from the wheel of the autopilot."""
    if "venv" in words:
        path = Path(words[-1])
        (path / "bin").mkdir(parents=True)
        (path / "pyvenv.cfg").write_text("include-system-site-packages = false\n")
        return
    path = Path(words[0]).parents[1]
    wheels = Path(words[1]).parents[1]
    program = path / "bin/rambler"
    program.write_text(next(wheels.glob("rambler_autopilot-*.whl")).read_text())
    program.chmod(0o755)


def begin(place, bundle):
    """Create a tree with an installed old program and its service."""
    place.mkdir()
    for name in ("bin", "opt", "state"):
        (place / name).mkdir()
    build(["venv", str(place / "opt/rambler")], None)
    program = place / "opt/rambler/bin/rambler"
    program.write_text(PROGRAM.format(version="old", code=0))
    program.chmod(0o755)
    (place / "bin/rambler").symlink_to(program)
    (place / "trial").write_text(build_trial_script())
    shutil.copy(bundle, place / "new.bundle")
    service = Service((str(place / "bin/rambler"),), place / "boat.toml", place / "state")
    (place / "boat.toml").write_text("")
    (place / "rambler.service").write_text(build_unit(service))


def run_update(place):
    """Make the update; the self check only tests whether the new program exists."""
    environment._run = build
    environment.check_free_space = lambda *_: None
    os.sync = lambda: None  # it would sync all disks of the machine
    update.self_check = lambda candidate: iter([str(candidate.environment.program.stat().st_size)])
    installation = Installation(ProgramLink(place / "bin/rambler"), place / "boat.toml", place / "state")
    update.update(installation, place / "new.bundle", None, Permissions(armed=False, older=False), lambda _text: None)


class Steps:
    """Counter of the steps, which ends the process or fails at a step."""

    def __init__(self, at, kind):
        self.at, self.kind, self.count, self.seen, self.busy = at, kind, 0, set(), False

    def install(self):
        sys.addaudithook(self.audit)
        if self.kind == "kill":
            sys.settrace(self.trace)

    def audit(self, event, words):
        changes = event in CHANGES or (event == "open" and isinstance(words[2], int) and words[2] & WRITING)
        if changes and (self.kind == "kill" or event in FILLING):
            self.step()

    def trace(self, frame, event, _word):
        if frame.f_code.co_filename not in TRACED:
            return None
        if event == "line" and (line := (frame.f_code.co_filename, frame.f_lineno)) not in self.seen:
            self.seen.add(line)
            self.step()
        return self.trace

    def step(self):
        number, self.count = self.count, self.count + 1
        if self.kind == "kill" and number == self.at:
            os.kill(os.getpid(), signal.SIGKILL)
        if self.kind == "full" and number >= self.at:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def update_until(place, at, kind):
    """Update in a child that ends at a step; return how it ended: killed, refused or done."""
    child = os.fork()
    if child == 0:
        code = 9
        try:
            Steps(at, kind).install()
            run_update(place)
            code = 0
        except (UpdateError, OSError):
            code = 2
        finally:
            os._exit(code)
    status = os.waitpid(child, 0)[1]
    return "killed" if os.WIFSIGNALED(status) else {0: "done", 2: "refused"}.get(os.WEXITSTATUS(status), "crashed")


def start_repeatedly(place, count=4):
    """Start the service `count` times like its unit; return the output of each start."""
    output = []
    for _ in range(count):
        link, state = place / "bin/rambler", place / "state"
        os.spawnv(
            os.P_WAIT,
            "/bin/sh",
            ["sh", "-c", 'exec sh "$@" >/dev/null 2>&1', "sh", str(place / "trial"), str(link), str(state)],
        )
        output.append(output_of(link))
    return output


def output_of(program):
    """Return the output of a program; empty if it does not start."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(writing, 1)
        try:
            os.execv(program, [str(program)])
        finally:
            os._exit(127)
    os.close(writing)
    with os.fdopen(reading) as output:
        text = output.read().strip()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return text if code == 0 else ""


def unreadable_paths(place):
    """Return the paths of the installed program that the user of the service cannot read."""
    target = (place / "bin/rambler").resolve()
    return [str(path) for path in (target, *target.parents[:2]) if not path.stat().st_mode & stat.S_IROTH]


def content_of(place):
    """Return the content of a tree, to compare it with others."""
    paths = [path for path in sorted(place.rglob("*")) if path.is_symlink() or not path.is_dir()]
    return tuple((str(path), str(path.readlink()) if path.is_symlink() else path.read_bytes()) for path in paths)


def outcome_of(place, how):
    """Return the outcome of an ended update: starts of the service, and result of the next update."""
    outcome = {"starts": start_repeatedly(place), "closed": unreadable_paths(place)}
    if how != "done":
        outcome["again"] = update_until(place, -1, "kill")
        outcome["starts again"] = start_repeatedly(place, 2)
    return outcome | {"left": sorted(path.name for path in (place / "opt").iterdir())}


def main(folder, bundle, kind, every="1"):
    """Print a line of JSON for each step at which an update was ended; the last line is for the complete update.

    `every` is the distance between two tested steps. The outcome is determined only once for equal trees.
    """
    place, outcomes = Path(folder) / "place", {}
    for at in itertools.count(step=int(every)):
        begin(place, bundle)
        how = update_until(place, at, kind)
        content = (how, content_of(place))
        if content not in outcomes:
            outcomes[content] = outcome_of(place, how)
        print(json.dumps({"at": at, "how": how, **outcomes[content]}), flush=True)
        shutil.rmtree(place)
        if how == "done":
            return


if __name__ == "__main__":
    main(*sys.argv[1:])
