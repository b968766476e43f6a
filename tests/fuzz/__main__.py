"""`make fuzz`: all targets, or those named, for a time in all; a table, and exit 1 on any finding.

What breaks something is made short and put into tests/fuzz/corpus, where a test plays it ever after. What
reaches new code is kept in .venv/.fuzz for the next run; `--merge` takes into the corpus what of it adds code.
"""

import argparse
import contextlib
import json
import os
import re
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from fuzz import engine
from fuzz.engine import CORPUS

ROOT = Path(__file__).parents[2]
KEPT = ROOT / ".venv" / ".fuzz"
LEAST_S = 2
PATIENCE_S = 120.0  # behind the end of its time
LOOK_EVERY_S = 0.1
MOST_GROWTH_KIB = 16 * 1024
COVERED = re.compile(r"^#\d+\s+(INITED|DONE) +cov: (\d+)", re.MULTILINE)
HEAD = f"{'target':20} {'inputs':>9} {'code':>6} {'new':>5} {'peak MiB':>9} {'growth KiB':>11}  findings"


@dataclass
class Child:
    """A process that fuzzes a target, and what it leaves behind."""

    name: str
    process: int
    end_s: float
    directory: tempfile.TemporaryDirectory

    @property
    def room(self):
        return Path(self.directory.name)


def begin(target, name, seconds, seed):
    """Start the engine on a target; the process inherits what has been imported."""
    directory = tempfile.TemporaryDirectory()
    room = Path(directory.name)
    process = os.fork()
    if process:
        return Child(name, process, time.monotonic() + seconds + PATIENCE_S, directory)
    code = 1
    with contextlib.suppress(BaseException):
        output = os.open(room / "output", os.O_WRONLY | os.O_CREAT)
        os.dup2(output, 1)
        os.dup2(output, 2)
        engine.run_target(target, CORPUS / name, seconds, seed, room, KEPT / name)
        code = 0
    os._exit(code)


def ended(child):
    """Return the exit status of a process, None while it runs; kill it after its time limit."""
    process, status = os.waitpid(child.process, os.WNOHANG)
    if process:
        return os.waitstatus_to_exitcode(status)
    if time.monotonic() > child.end_s:
        os.kill(child.process, signal.SIGKILL)
        child.end_s = float("inf")
    return None


def side_by_side(targets, names, jobs, share_s, seed):
    """Fuzz targets in so many processes; yield each as it ends, with its exit code."""
    waiting, running = list(names), []
    while waiting or running:
        while waiting and len(running) < jobs:
            seconds = share_s(len(waiting))
            name = waiting.pop(0)
            running.append(begin(targets[name], name, seconds, seed))
        for child in tuple(running):
            code = ended(child)
            if code is not None:
                running.remove(child)
                yield child, code
        time.sleep(LOOK_EVERY_S)


def outcome(child, code):
    """Return the row of a target in the table, and its findings in words."""
    output = (child.room / "output").read_text(errors="replace")
    result = child.room / "result.json"
    report = json.loads(result.read_text()) if result.exists() else {}
    findings = list(report.get("found", {}).values())
    if code:
        findings.append(f"it ended with {code}:\n{output[-2000:]}")
    growth = report.get("growth_kib")
    if growth is not None and growth > MOST_GROWTH_KIB:
        findings.append(f"memory grew by {growth} KiB")
    for path in (child.room / "found").glob("*"):
        shutil.copy(path, CORPUS / child.name / path.name)
    code_of = {when: int(count) for when, count in COVERED.findall(output)}
    begun, done = code_of.get("INITED"), code_of.get("DONE")
    new = "-" if begun is None or done is None else done - begun
    row = f"{child.name:20} {report.get('inputs', 0):9} {done or '-':>6} {new:>5} {report.get('peak_kib', 0) // 1024:9}"
    return f"{row} {'-' if growth is None else growth:>11}  {len(findings) or ''}".rstrip(), findings


def fuzz(targets, names, seconds, seed, jobs):
    """Fuzz for a time in all and print a table; return whether nothing was found."""
    end_s, sound = time.monotonic() + seconds, True

    def share_s(left):
        return max(LEAST_S, int((end_s - time.monotonic()) * jobs / max(left, jobs)))

    print(HEAD, flush=True)
    for child, code in side_by_side(targets, names, jobs, share_s, seed):
        row, findings = outcome(child, code)
        child.directory.cleanup()
        print(row, *(f"--- {finding}" for finding in findings), sep="\n", flush=True)
        sound = sound and not findings
    return sound


def merge(targets, names, jobs):
    """Take into the corpus what of the kept inputs adds code."""
    for child, code in side_by_side(targets, names, jobs, lambda _: 0, 1):
        files = [path.stat().st_size for path in (CORPUS / child.name).glob("*")]
        print(f"{child.name:20} {len(files):5} inputs {sum(files):9} bytes{'' if code == 0 else ' FAILED'}", flush=True)
        child.directory.cleanup()


def main():
    parser = argparse.ArgumentParser(prog="make fuzz", description=__doc__)
    parser.add_argument("targets", metavar="TARGET", nargs="*", help="those named, else all")
    parser.add_argument("--seconds", type=float, default=600.0, help="for all targets together")
    parser.add_argument("--seed", type=int, default=1, help="another one makes other inputs")
    parser.add_argument("--jobs", type=int, default=2, help="targets at a time")
    parser.add_argument("--merge", action="store_true", help="take what was kept into the corpus instead")
    arguments = parser.parse_args()
    targets = engine.instrumented_targets()
    names = arguments.targets or list(targets)
    if unknown := set(names) - set(targets):
        parser.error(f"no target {', '.join(sorted(unknown))}; there are {', '.join(targets)}")
    if arguments.merge:
        merge(targets, names, arguments.jobs)
        return 0
    how = "guided by atheris" if engine.atheris else "at random, without atheris"
    print(f"{len(names)} targets, {arguments.seconds:g} s, seed {arguments.seed}, {how}")
    if fuzz(targets, names, arguments.seconds, arguments.seed, arguments.jobs):
        return 0
    print(f"what was found is in {CORPUS.relative_to(ROOT)}: mend it, and commit it with the change")
    return 1


if __name__ == "__main__":
    sys.exit(main())
