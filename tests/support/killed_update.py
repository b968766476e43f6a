"""Updates of a small tree of programs, each ended at another step: run as a program, which forks one child for each.

A step is each change of the disk that Python makes (by audit events: opened for writing, made, renamed, linked,
removed, a program started), just before it, and each line of the updating modules when it is first reached, so that
what was written and not yet flushed is torn. `kill` ends the child there by SIGKILL; `full` lets this change and all
later ones find the disk full.
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
FILLING = ("open", "os.mkdir", "os.symlink", "os.rename", "subprocess.Popen")  # what needs room
WRITING = os.O_WRONLY | os.O_RDWR
TRACED = tuple(module.__file__ for module in (environment, program_link, self_check, update))
PROGRAM = '#!/bin/sh\necho "steers {version}"\nexit {code}\n'


def build(words, _held):
    """In place of venv and pip: the tree that they make, from the one wheel of the autopilot."""
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
    """A tree with an old program in force and a service of it."""
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


def update_it(place):
    """Make the update; what is checked of the new program here is that it is there."""
    environment._run = build
    environment.check_free_space = lambda *_: None
    os.sync = lambda: None  # of all disks of this machine
    update.self_check = lambda candidate: iter([str(candidate.environment.program.stat().st_size)])
    installation = Installation(ProgramLink(place / "bin/rambler"), place / "boat.toml", place / "state")
    update.update(installation, place / "new.bundle", None, Permissions(), lambda _text: None)


class Steps:
    """Ends, or fails, at one step."""

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


def ended_at(place, at, kind):
    """Update in a child that is ended at a step; return how: killed, refused, done."""
    child = os.fork()
    if child == 0:
        code = 9
        try:
            Steps(at, kind).install()
            update_it(place)
            code = 0
        except (UpdateError, OSError):
            code = 2
        finally:
            os._exit(code)
    status = os.waitpid(child, 0)[1]
    return "killed" if os.WIFSIGNALED(status) else {0: "done", 2: "refused"}.get(os.WEXITSTATUS(status), "crashed")


def starts(place, count=4):
    """Start the service again and again as its unit does; return what each start says."""
    output = []
    for _ in range(count):
        link, state = place / "bin/rambler", place / "state"
        os.spawnv(
            os.P_WAIT,
            "/bin/sh",
            ["sh", "-c", 'exec sh "$@" >/dev/null 2>&1', "sh", str(place / "trial"), str(link), str(state)],
        )
        output.append(said_by(link))
    return output


def said_by(program):
    """What a program says when it runs, empty when it does not start."""
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


def modes(place):
    """What of the program in force its service's user could not read."""
    target = (place / "bin/rambler").resolve()
    return [str(path) for path in (target, *target.parents[:2]) if not path.stat().st_mode & stat.S_IROTH]


def content_of(place):
    """All that is in a tree, to know it again."""
    paths = [path for path in sorted(place.rglob("*")) if path.is_symlink() or not path.is_dir()]
    return tuple((str(path), str(path.readlink()) if path.is_symlink() else path.read_bytes()) for path in paths)


def after(place, how):
    """What becomes of a tree in which an update has ended: the starts of its service, and the next update."""
    outcome = {"starts": starts(place), "closed": modes(place)}
    if how != "done":
        outcome["again"] = ended_at(place, -1, "kill")
        outcome["starts again"] = starts(place, 2)
    return outcome | {"left": sorted(path.name for path in (place / "opt").iterdir())}


def main(folder, bundle, kind, every="1"):
    """Print a line of JSON for each step at which an update was ended, the last one for the update that was not.

    `every` is the distance between two steps that are tried. What becomes of a tree is found out once for trees that
    are equal.
    """
    place, known = Path(folder) / "place", {}
    for at in itertools.count(step=int(every)):
        begin(place, bundle)
        how = ended_at(place, at, kind)
        content = (how, content_of(place))
        if content not in known:
            known[content] = after(place, how)
        print(json.dumps({"at": at, "how": how, **known[content]}), flush=True)
        shutil.rmtree(place)
        if how == "done":
            return


if __name__ == "__main__":
    main(*sys.argv[1:])
