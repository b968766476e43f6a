"""A recorded run is recomputed bit for bit, so that a change of the control path fails here.

After an intended change, recompute the logs (relog.py) or accept the change in data/accepted.json
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


def test_recorded_run_is_recomputed_bit_for_bit(capsys):
    assert main(["replay", str(LOG), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["identical"]
    assert report["compared"] == report["ticks"] > 390


def test_recorded_run_has_goals_headings_and_a_large_rudder_angle():
    ticks = list(read_log(LOG))
    intents = [request.intent for tick in ticks for request in tick.inputs.requests]
    assert SteerHeading(math.radians(60.0)) in intents
    assert max(tick.command.shaft_rad for tick in ticks) == pytest.approx(math.radians(30.0), abs=1e-2)
    assert sum(len(tick.inputs.headings) for tick in ticks) > 150
    assert sum(len(tick.inputs.rudder) for tick in ticks) > 150


@pytest.mark.parametrize("fraction", [0.3, 0.77, 0.999])
def test_truncated_log_is_recomputed_to_its_last_complete_tick(tmp_path, capsys, fraction):
    content = LOG.read_bytes()
    path = tmp_path / "cut.BIN"
    path.write_bytes(content[: int(fraction * len(content))])
    assert main(["replay", str(path)]) == 0
    assert "every rudder command is bit-identical" in capsys.readouterr().out


def test_change_of_the_last_bits_of_a_gain_is_detected(capsys, monkeypatch):
    from firmware_py.control import law  # noqa: PLC0415 - patched only here

    gains_of = law.gains_of

    def changed_gains_of(ship, gain):
        gains = gains_of(ship, gain)
        return gains._replace(k1=gains.k1 * (1.0 + 16.0 * sys.float_info.epsilon))

    monkeypatch.setattr(law, "gains_of", changed_gains_of)
    assert main(["replay", str(LOG)]) == 1
    assert "NOT identical" in capsys.readouterr().out
