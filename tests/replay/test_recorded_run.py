"""A recorded run is recomputed bit for bit: a change of the control path shows here.

When the control is meant to change, compute the logs again (relog.py), or accept it in data/accepted.json
(test_earlier_versions.py). The run was recorded by:
rambler-hil run tank --speed max --seconds 40 --goal "0:0,5:60" --compass pni --servo volz --set CTL_K1=38
"""

import json
import math
import sys

import pytest

from firmware_py.__main__ import main
from firmware_py.common.intents import SteerHeading
from firmware_py.log.reader import read_log
from support.paths import REPLAY

LOG = REPLAY / "tank_pni_volz.BIN"


def test_the_recorded_run_is_recomputed_bit_for_bit(capsys):
    assert main(["replay", str(LOG), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["identical"]
    assert report["compared"] == report["ticks"] > 390


def test_the_recorded_run_is_worth_replaying():
    ticks = list(read_log(LOG))
    intents = [request.intent for tick in ticks for request in tick.inputs.requests]
    assert SteerHeading(math.radians(60.0)) in intents
    assert max(tick.command.shaft_rad for tick in ticks) == pytest.approx(math.radians(30.0), abs=1e-2)
    assert sum(len(tick.inputs.headings) for tick in ticks) > 150
    assert sum(len(tick.inputs.rudder) for tick in ticks) > 150


@pytest.mark.parametrize("keep", [0.3, 0.77, 0.999])
def test_a_log_cut_anywhere_is_recomputed_to_its_last_whole_tick(tmp_path, capsys, keep):
    whole = LOG.read_bytes()
    cut = tmp_path / "cut.BIN"
    cut.write_bytes(whole[: int(keep * len(whole))])
    assert main(["replay", str(cut)]) == 0
    assert "every rudder command is bit-identical" in capsys.readouterr().out


def test_a_change_of_the_last_bits_of_a_gain_is_found(capsys, monkeypatch):
    from firmware_py.control import law  # noqa: PLC0415 - patched only here

    right = law.gains_of

    def nearly_right(ship, gain):
        gains = right(ship, gain)
        return gains._replace(k1=gains.k1 * (1.0 + 16.0 * sys.float_info.epsilon))

    monkeypatch.setattr(law, "gains_of", nearly_right)
    assert main(["replay", str(LOG)]) == 1
    assert "NOT identical" in capsys.readouterr().out
