"""The script of the sea trial, started with the command on its page."""

import math
import sys

import numpy as np
import pytest

from support.paths import ROOT

SCRIPT = ROOT / "docs" / "how-to" / "sea_trial.py"


def start_trial(start, manoeuvre, port):
    return start("sea trial", [sys.executable, str(SCRIPT), manoeuvre, f"udpin:127.0.0.1:{port}"])


@pytest.mark.proof
def test_zigzag_changes_the_rudder_at_least_nine_times_and_returns_to_steering(start_hil, start):
    """Run it with `pytest -m proof tests/clients/test_sea_trial.py`; it takes two minutes."""
    hil = start_hil("udpout", scenario="tank", speed="5")
    program = start_trial(start, "zigzag", hil.ports[0])
    assert program.exit_code(120.0) == 0, program.text()
    truth = hil.end()
    rudder_signs = np.sign(truth.rudder_rad[np.abs(truth.rudder_rad) > math.radians(15.0)])
    assert np.count_nonzero(np.diff(rudder_signs)) >= 9
    assert "Mode STEERING" in hil.firmware_log.read_text()


def test_trial_of_a_disarmed_boat_ends_with_an_error(boot, start, free_ports):
    (port,) = free_ports(["udpin"])
    boot("boat", f"udpout:127.0.0.1:{port}")
    program = start_trial(start, "circle", port)
    assert program.exit_code(60.0) == 1
    assert "the boat is not armed" in program.text()
