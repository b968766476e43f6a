"""Parser and extractor of UAVLogViewer, run by node, with the log of a mission inside a fence.

UAVLOGVIEWER is the path of a checkout of ArduPilot/UAVLogViewer with its submodule; without it or node, the test is
skipped.
"""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from pymavlink import mavutil

from firmware_py.common.plan import PlanKind
from support.graphs import count_graphs
from support.harness import rambler_hil
from support.plans import FENCE_ITEMS, item, save_plans

TOOLS = Path(os.environ.get("UAVLOGVIEWER", "UAVLogViewer")) / "src/tools"
PARTS = ("paramseeker.js", "datetools.js", "parsers/JsDataflashParser/parser.js", "dataflashDataExtractor.js")
MISSING = [] if shutil.which("node") else ["node"]
MISSING += [str(TOOLS / part) for part in PARTS if not (TOOLS / part).exists()]
pytestmark = pytest.mark.proof

# The steps of its pages for a dropped file (parser.worker.js and Home.vue), without the pages.
BEFORE = """
const self = { addEventListener () {} }, window = {}, Vue = { prototype: {} }, say = console.log
console.log = () => {}
"""
AFTER = """
const file = require('fs').readFileSync(process.argv[1])
const wanted = 'CMD MSG FILE MODE AHR2 ATT GPS POS SIM XKQ1 XKQ NKQ1 NKQ2 XKQ2 PARM MSG STAT EV XKF4 FNCE'.split(' ')
const { messages } = new DataflashParser().processData(new Uint8Array(file).buffer, wanted)
const X = DataflashDataExtractor, track = source => X.extractTrajectory(messages, source)[source].trajectory
say(JSON.stringify({
  modes: X.extractFlightModes(messages), events: X.extractEvents(messages), mission: X.extractMission(messages),
  fences: X.extractFences(messages).map(one => [one.length, one.exclusion, one[0][2]]),
  vehicle: X.extractVehicleType(messages), parameters: X.extractParams(messages).values,
  start: X.extractStartTime(messages['GPS[0]']),
  texts: X.extractTextMessages(messages).map(one => one[2]),
  attitudes: X.extractAttitudeSources(messages).eulers
    .map(source => Object.values(X.extractAttitude(messages, source))),
  tracks: X.extractTrajectorySources(messages).map(source => [source, track(source)])
}))
"""
MISSION = [item(16, 30, 0), item(178, None, None, 0, 0.5), item(16, 30, 80), item(20)]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    directory = tmp_path_factory.mktemp("run")
    state = save_plans(directory / "state", {PlanKind.MISSION: MISSION, PlanKind.FENCE: FENCE_ITEMS})
    arguments = ["run", "mission", "--mode", "auto", "--state", state, "--speed", "max", "--seconds", "200"]
    arguments += ["--with", "supply=20:0.9:30:6:0.22", "--set", "FENCE_ENABLE=1", "LOIT_RADIUS=20"]
    assert rambler_hil(*arguments, "--out", directory / "out")[0] == 0
    return directory / "out/state/logs/00000001.BIN"


@pytest.mark.skipif(bool(MISSING), reason=f"missing: {', '.join(MISSING)}")
def test_uavlogviewer_reads_attitude_track_mission_fence_modes_and_arming(log):
    parts = [
        re.sub(r"^(import .*|export( default)?)", "", (TOOLS / part).read_text(), flags=re.MULTILINE) for part in PARTS
    ]
    script = "\n".join([BEFORE, *parts, AFTER])
    process = subprocess.run(["node", "--eval", script, str(log)], capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr
    extracted = json.loads(process.stdout)
    assert [mode for _, mode in extracted["modes"]] == ["HOLD", "AUTO"]
    assert [event for _, event in extracted["events"]] == ["DISARMED", "FENCE_ENABLE", "ARMED", "SET_HOME"]
    assert [item[4] for item in extracted["mission"]] == [16, 16]
    assert extracted["mission"][0][:2] == pytest.approx([121.0, 36.00027], abs=1e-5)
    assert extracted["fences"] == [[4, False, 0], [3, True, 0], [1, True, 30]]
    assert extracted["vehicle"] == "boat"
    assert extracted["parameters"]["LOIT_RADIUS"] == 20
    assert extracted["start"].startswith("2026-01-01T00:00")
    assert "Armed" in extracted["texts"]
    assert len(extracted["attitudes"]) == 2
    assert all(None not in angles for source in extracted["attitudes"] for angles in source)  # NaN in JSON
    assert [name for name, _ in extracted["tracks"]] == ["POS", "AHR2", "GPS[0]"]
    for _, track in extracted["tracks"]:
        assert len(track) > 15
        assert track[-1][:2] == pytest.approx([121.0, 36.0], abs=1e-3)


def test_mavexplorer_draws_at_least_60_of_its_graphs(log):
    reader = mavutil.mavlink_connection(str(log))
    while reader.recv_match() is not None:
        pass
    graphs, total = count_graphs(dict(reader.messages))
    reader.close()
    print(f"MAVExplorer draws {graphs} of its {total} expressions")
    assert graphs >= 60
