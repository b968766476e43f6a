"""The script of the sea trial, run as its page says."""

import math
import sys

import numpy as np
import pytest

from support.paths import ROOT

SCRIPT = ROOT / "docs" / "how-to" / "sea_trial.py"


def trial(start, what, port):
    return start("sea trial", [sys.executable, str(SCRIPT), what, f"udpin:127.0.0.1:{port}"])


@pytest.mark.proof
def test_a_zigzag_changes_the_rudder_every_20_degrees_and_returns_to_steering(start_hil, start):
    """`pytest -m proof tests/clients/test_sea_trial.py`: two minutes."""
    hil = start_hil("udpout", scenario="tank", speed="5")
    program = trial(start, "zigzag", hil.ports[0])
    assert program.exit_code(120.0) == 0, program.text()
    truth = hil.end()
    sides = np.sign(truth.rudder_rad[np.abs(truth.rudder_rad) > math.radians(15.0)])
    assert np.count_nonzero(np.diff(sides)) >= 9
    assert "Mode STEERING" in hil.firmware_log.read_text()


def test_a_disarmed_boat_is_reported_at_once(boot, start, free_ports):
    (port,) = free_ports(["udpin"])
    boot("boat", f"udpout:127.0.0.1:{port}")
    program = trial(start, "circle", port)
    assert program.exit_code(60.0) == 1
    assert "the boat is not armed" in program.text()
