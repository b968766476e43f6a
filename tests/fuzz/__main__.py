"""`make fuzz`: fuzz all targets or the named ones for a total time; print a table and exit with 1 for a finding.

Inputs that cause an error are shortened and added to tests/fuzz/corpus, which a test runs. Inputs that reach new code
are stored in .venv/.fuzz for the next run; `--merge` adds those that extend the coverage to the corpus.
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
NEW_INPUTS = ROOT / ".venv" / ".fuzz"
MIN_TIME_S = 2
GRACE_S = 120.0  # after the end of the time of a child
POLL_INTERVAL_S = 0.1
MAX_GROWTH_KIB = 16 * 1024
COVERAGE_LINE = re.compile(r"^#\d+\s+(INITED|DONE) +cov: (\d+)", re.MULTILINE)
TITLE_LINE = f"{'target':20} {'inputs':>9} {'code':>6} {'new':>5} {'peak MiB':>9} {'growth KiB':>11}  findings"


@dataclass
class Child:
    """A process that fuzzes a target, and its directory of results."""

    name: str
    process: int
    end_s: float
    temporary: tempfile.TemporaryDirectory

    @property
    def directory(self):
        return Path(self.temporary.name)


def start_child(target, name, seconds, seed):
    """Start the engine on a target in a fork, which inherits the imported modules."""
    temporary = tempfile.TemporaryDirectory()
    directory = Path(temporary.name)
    process = os.fork()
    if process:
        return Child(name, process, time.monotonic() + seconds + GRACE_S, temporary)
    code = 1
    with contextlib.suppress(BaseException):
        output = os.open(directory / "output", os.O_WRONLY | os.O_CREAT)
        os.dup2(output, 1)
        os.dup2(output, 2)
        engine.run_target(target, CORPUS / name, seconds, seed, directory, NEW_INPUTS / name)
        code = 0
    os._exit(code)


def exit_code_of(child):
    """Return the exit status of a process, None while it runs; kill it after its time limit."""
    process, status = os.waitpid(child.process, os.WNOHANG)
    if process:
        return os.waitstatus_to_exitcode(status)
    if time.monotonic() > child.end_s:
        os.kill(child.process, signal.SIGKILL)
        child.end_s = float("inf")
    return None


def fuzz_in_parallel(targets, names, jobs, share_s, seed):
    """Fuzz targets in `jobs` processes; yield each one with its exit code when it ends."""
    pending, running = list(names), []
    while pending or running:
        while pending and len(running) < jobs:
            seconds = share_s(len(pending))
            name = pending.pop(0)
            running.append(start_child(targets[name], name, seconds, seed))
        for child in tuple(running):
            code = exit_code_of(child)
            if code is not None:
                running.remove(child)
                yield child, code
        time.sleep(POLL_INTERVAL_S)


def format_result(child, code):
    """Return the row of a target in the table, and the texts of its findings."""
    output = (child.directory / "output").read_text(errors="replace")
    result = child.directory / "result.json"
    report = json.loads(result.read_text()) if result.exists() else {}
    findings = list(report.get("findings", {}).values())
    if code:
        findings.append(f"exit code {code}:\n{output[-2000:]}")
    growth = report.get("growth_kib")
    if growth is not None and growth > MAX_GROWTH_KIB:
        findings.append(f"memory grew by {growth} KiB")
    for path in (child.directory / "findings").glob("*"):
        shutil.copy(path, CORPUS / child.name / path.name)
    coverage = {phase: int(count) for phase, count in COVERAGE_LINE.findall(output)}
    initial, final = coverage.get("INITED"), coverage.get("DONE")
    new = "-" if initial is None or final is None else final - initial
    row = (
        f"{child.name:20} {report.get('inputs', 0):9} {final or '-':>6} {new:>5} {report.get('peak_kib', 0) // 1024:9}"
    )
    return f"{row} {'-' if growth is None else growth:>11}  {len(findings) or ''}".rstrip(), findings


def fuzz(targets, names, seconds, seed, jobs):
    """Fuzz for a total time and print a table; return whether there was no finding."""
    end_s, is_clean = time.monotonic() + seconds, True

    def share_s(pending_count):
        return max(MIN_TIME_S, int((end_s - time.monotonic()) * jobs / max(pending_count, jobs)))

    print(TITLE_LINE, flush=True)
    for child, code in fuzz_in_parallel(targets, names, jobs, share_s, seed):
        row, findings = format_result(child, code)
        child.temporary.cleanup()
        print(row, *(f"--- {finding}" for finding in findings), sep="\n", flush=True)
        is_clean = is_clean and not findings
    return is_clean


def merge(targets, names, jobs):
    """Add the new inputs that extend the coverage to the corpus."""
    for child, code in fuzz_in_parallel(targets, names, jobs, lambda _: 0, 1):
        sizes = [path.stat().st_size for path in (CORPUS / child.name).glob("*")]
        print(f"{child.name:20} {len(sizes):5} inputs {sum(sizes):9} bytes{'' if code == 0 else ' FAILED'}", flush=True)
        child.temporary.cleanup()


def main():
    parser = argparse.ArgumentParser(prog="make fuzz", description=__doc__)
    parser.add_argument("targets", metavar="TARGET", nargs="*", help="targets (default: all)")
    parser.add_argument("--seconds", type=float, default=600.0, help="total time of all targets")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random inputs")
    parser.add_argument("--jobs", type=int, default=2, help="number of parallel processes")
    parser.add_argument("--merge", action="store_true", help="add the stored new inputs to the corpus instead")
    arguments = parser.parse_args()
    targets = engine.import_targets()
    names = arguments.targets or list(targets)
    if unknown := set(names) - set(targets):
        parser.error(f"no target {', '.join(sorted(unknown))}; there are {', '.join(targets)}")
    if arguments.merge:
        merge(targets, names, arguments.jobs)
        return 0
    method = "guided by atheris" if engine.atheris else "at random, without atheris"
    print(f"{len(names)} targets, {arguments.seconds:g} s, seed {arguments.seed}, {method}")
    if fuzz(targets, names, arguments.seconds, arguments.seed, arguments.jobs):
        return 0
    print(f"the inputs are in {CORPUS.relative_to(ROOT)}: correct the errors and commit both")
    return 1


if __name__ == "__main__":
    sys.exit(main())
