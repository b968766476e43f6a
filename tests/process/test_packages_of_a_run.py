"""A simulated run needs only the packages of the extra [sim]; other commands name the missing extra."""

import subprocess
import sys

PROGRAM = """
import sys
for name in ("numba", "llvmlite", "scipy", "cma"):
    sys.modules[name] = None
from hil.__main__ import main
sys.exit(main(sys.argv[1:]))
"""


def run_without_laboratory_packages(*words, cwd):
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *words], cwd=cwd, capture_output=True, text=True, timeout=120, check=False
    )


def test_simulated_run_needs_no_package_of_the_laboratory(tmp_path):
    run = run_without_laboratory_packages(
        "run", "tank", "--speed", "max", "--seconds", "5", "--out", "run", cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "run" / "report.html").exists()


def test_command_with_missing_package_names_the_extra(tmp_path):
    run = run_without_laboratory_packages("tune", cwd=tmp_path)
    assert run.returncode == 2
    assert run.stderr.startswith("rambler-hil: ")
    assert "is not installed; pip install 'rambler-autopilot[hil]'" in run.stderr
    assert "Traceback" not in run.stderr
