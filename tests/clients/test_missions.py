"""Missions, fences and rally points of MAVSDK, MAVProxy and pymavlink with `rambler run`."""

import importlib.util
import json
import os
import re
import shutil
import signal
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firmware_py.__main__ import main
from firmware_py.common.plan import PlanKind, from_text
from firmware_py.system.slots import read_content
from firmware_py.system.state_directory import PLAN_FILES

CLIENT = Path(__file__).with_name("mavsdk_missions.py")
NOT_USABLE = 77
SESSION_S = 90.0  # maximum; a few seconds on an idle machine
ITEMS = 500

CORNERS = [[36.0, 121.0], [36.0, 121.2], [36.2, 121.1]]
PLAN = {
    "fileType": "Plan",
    "version": 1,
    "groundStation": "QGroundControl",
    "mission": {
        "version": 2,
        "firmwareType": 3,
        "vehicleType": 11,
        "cruiseSpeed": 15,
        "hoverSpeed": 5,
        "plannedHomePosition": [36.0, 121.0, 0],
        "items": [
            {
                "type": "SimpleItem",
                "autoContinue": True,
                "command": 16,
                "doJumpId": 1,
                "frame": 3,
                "params": [0, 0, 0, None, 36.1, 121.1, 0],
            }
        ],
    },
    "geoFence": {
        "version": 2,
        "polygons": [{"version": 1, "inclusion": True, "polygon": CORNERS}],
        "circles": [{"version": 1, "inclusion": False, "circle": {"center": [36.1, 121.1], "radius": 250.5}}],
    },
    "rallyPoints": {"version": 2, "points": [[36.01, 121.05, 0], [36.02, 121.06, 1.5]]},
}


@pytest.fixture
def start_boat_on(boot, free_ports):
    """Return a function that starts the boat on a kind of link; it returns the program and the port."""

    def start_boat(name, kind="udpout"):
        (port,) = free_ports([kind])
        return boot(name, f"{kind}:127.0.0.1:{port}"), port

    return start_boat


def test_mavsdk_uploads_and_downloads_plans(tmp_path, start, start_boat_on):
    if importlib.util.find_spec("mavsdk") is None:
        pytest.skip("mavsdk is not installed; install the extra [clients]")
    (tmp_path / "a.plan").write_text(json.dumps(PLAN))
    program, port = start_boat_on("autopilot")
    result_file = tmp_path / "results.json"
    words = [sys.executable, str(CLIENT), f"udpin://127.0.0.1:{port}", str(tmp_path / "a.plan"), str(result_file)]
    client = start("mavsdk", words)
    code = client.exit_code(SESSION_S)
    if code == NOT_USABLE:
        pytest.skip(client.text().strip().splitlines()[-1])
    if code != 0:
        client.fail(f"the client ended with code {code}")
    results = json.loads(result_file.read_text())
    assert len(results["got"]) == 1 + ITEMS
    assert results["got"][1:] == results["sent"][1:]  # item 0 is home, which the boat does not replace
    assert results["fence_got"] == results["fence_sent"]
    assert results["rally_got"] == results["rally_sent"]
    assert [len(results["fence_got"]), len(results["rally_got"])] == [4, 2]
    assert results["progress"][0] in (0, 1)
    assert results["total"] in (ITEMS, ITEMS + 1)
    assert (results["bad"], results["after_bad"], results["after_clear"]) == ("UNSUPPORTED", 1 + ITEMS, 0)
    program.send_signal(signal.SIGTERM)
    assert program.exit_code() == 0
    # MAVSDK and `rambler plan` read the same plan from the file of QGroundControl.
    check_same_as_file(tmp_path, results)


def check_same_as_file(tmp_path, results):
    assert main(["plan", "save", str(tmp_path / "out.plan"), "--state", str(tmp_path / "state")]) == 0
    saved = json.loads((tmp_path / "out.plan").read_text())
    assert saved["geoFence"]["polygons"] == PLAN["geoFence"]["polygons"]
    assert saved["geoFence"]["circles"] == PLAN["geoFence"]["circles"]
    assert saved["rallyPoints"] == PLAN["rallyPoints"]


# --------------------------------------------------------------------------------- MAVProxy


def line(number, frame, command, params, x, y, z=0.0, current=0):
    return "\t".join(map(str, [number, current, frame, command, *params, x, y, z, 1])) + "\n"


WAYPOINTS = [
    line(0, 0, 16, [0.0] * 4, 36.0, 121.0, current=1),
    line(1, 3, 16, [0.0, 5.0, 0.0, 0.0], 36.1, 121.1),
    line(2, 3, 19, [60.0, 0.0, -20.0, 0.0], 36.2, -121.2, 1.5),
    line(3, 0, 177, [1.0, -1.0, 0.0, 0.0], 0.0, 0.0),
]
FENCE = [line(index, 0, 5001, [3.0, 0.0, 0.0, 0.0], *corner) for index, corner in enumerate(CORNERS)]
RALLY = [line(index, 3, 5100, [0.0] * 4, 36.01 + index, 121.0, 2.0) for index in range(2)]


def test_mavproxy_loads_lists_and_saves_plans(tmp_path, start, start_boat_on):
    script = shutil.which("mavproxy.py", path=str(Path(sys.executable).parent))
    if script is None:
        pytest.skip("mavproxy.py is not beside this Python; install the extra [clients]")
    home = tmp_path / "home"
    home.mkdir()
    program, port = start_boat_on("autopilot")
    command = [sys.executable, script, f"--master=udpin:127.0.0.1:{port}", f"--state-basedir={home}"]
    env = {**os.environ, "HOME": str(home), "PYTHONUNBUFFERED": "1"}
    client = start("mavproxy", command, cwd=home, env=env)
    client.expect("online system 1")
    client.expect(r"Saved \d+ parameters")
    for name, what, lines in (
        ("wp", "waypoints", WAYPOINTS),
        ("fence", "fence items", FENCE),
        ("rally", "rally items", RALLY),
    ):
        (home / f"{name}.txt").write_text("QGC WPL 110\n" + "".join(lines))
        client.say(f"{name} load {name}.txt")
        client.expect(f"Loaded {len(lines)} {what} in ")
        stored_count = len(lines) - (name == "wp")  # home is not stored
        client.wait_for(
            lambda name=name, count=stored_count: count_stored(tmp_path, name) == count, f"{stored_count} stored {what}"
        )
        client.expect(r"Got MISSION_ACK: TYPE_\w+: ACCEPTED")  # until then MAVProxy is still sending
        client.say(f"{name} save {name}-again.txt")
        client.expect(f"Saved {len(lines)} {what} to {name}-again.txt")
        assert numbers(home / f"{name}-again.txt")[name == "wp" :] == numbers(home / f"{name}.txt")[name == "wp" :]
        client.say(f"{name} list")
        client.expect(rf"(?m)^{lines[-1].split()[3]} \d ")
    client.say("wp clear")
    client.wait_for(lambda: count_stored(tmp_path, "wp") == 0, "an empty mission")
    # The same mission in one file transfer.
    client.say("wp ftpload wp.txt")
    client.expect(f"Sent waypoint of length {len(WAYPOINTS)} in ")
    client.wait_for(lambda: count_stored(tmp_path, "wp") == len(WAYPOINTS) - 1, "the stored mission")
    client.say("wp ftp")
    client.expect(rf"(?m)^{WAYPOINTS[-1].split()[3]} \d ")
    client.hang_up()
    client.exit_code()
    program.send_signal(signal.SIGTERM)
    assert program.exit_code() == 0


def numbers(path):
    """Return the numbers of a file of items, without sequence and current item."""
    return [[float(word) for word in row.split()[2:]] for row in path.read_text().splitlines()[1:]]


def count_stored(tmp_path, name):
    """Return the number of items of a plan in the state directory, None without a plan."""
    kind = {"wp": PlanKind.MISSION, "fence": PlanKind.FENCE, "rally": PlanKind.RALLY}[name]
    content = read_content(tmp_path / "state", PLAN_FILES[kind])
    return None if content is None else len(from_text(content.decode())[0].items)


# -------------------------------------------------------------------------- killed processes


def item(sequence, start):
    position = (360_000_000 + start + sequence, 1_210_000_000, 0.0)
    return mavlink.MAVLink_mission_item_int_message(1, 1, sequence, 6, 16, 0, 1, 0, 0, 0, 0, *position, 0)


def send_items(station, count, start, until):
    """Answer requests up to an item; return after the request for the next one."""
    station.mav.mission_count_send(1, 1, count, 0)
    for sequence in range(until):
        station.receive("MISSION_REQUEST_INT", lambda request, wanted=sequence: request.seq == wanted)
        station.mav.send(item(sequence, start))


def latitudes(station):
    """Download the mission; return the latitudes of its items without home."""
    station.mav.mission_request_list_send(1, 1, 0)
    count = station.receive("MISSION_COUNT").count
    rows = []
    for sequence in range(count):
        station.mav.mission_request_int_send(1, 1, sequence, 0)
        rows.append(station.receive("MISSION_ITEM_INT", lambda row, wanted=sequence: row.seq == wanted).x)
    return rows[1:]


def expected(count, start):
    """Return the latitudes of a mission that `send_items` has sent."""
    return [360_000_000 + start + sequence for sequence in range(1, count)]


def test_mission_after_a_kill_is_the_old_one_or_the_new_one(start_boat_on, connect):
    def reboot(name):
        program, port = start_boat_on(name, "tcpin")
        return program, connect(f"tcp:127.0.0.1:{port}")

    program, station = reboot("first")
    send_items(station, 40, 0, 40)
    assert station.receive("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
    program.send_signal(signal.SIGKILL)  # directly after the acknowledgement
    program.exit_code()

    program, station = reboot("second")
    assert latitudes(station) == expected(40, 0)
    send_items(station, 60, 1000, 30)
    station.receive("MISSION_REQUEST_INT", lambda request: request.seq == 30)
    program.send_signal(signal.SIGKILL)  # during the upload
    program.exit_code()

    program, station = reboot("third")
    assert latitudes(station) == expected(40, 0)
    send_items(station, 600, 2000, 600)
    program.send_signal(signal.SIGKILL)  # about while it is stored
    program.exit_code()

    program, station = reboot("fourth")
    assert latitudes(station) in (expected(40, 0), expected(600, 2000))
    send_items(station, 60, 5000, 30)
    station.mav.mission_ack_send(1, 1, mavlink.MAV_MISSION_OPERATION_CANCELLED, 0)
    assert latitudes(station) in (expected(40, 0), expected(600, 2000))
    program.send_signal(signal.SIGTERM)
    assert program.exit_code() == 0
    assert not re.search("left out", program.text())
