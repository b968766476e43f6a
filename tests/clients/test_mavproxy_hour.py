"""An hour of operation with the console of MAVProxy: each line that it writes is listed here as correct.

`pytest -m proof tests/clients/test_mavproxy_hour.py -s`, in real time; `MAVPROXY_S=300` for a short run.
"""

import os
import re
import time

import pytest

from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG
from support.program import unused_ports
from support.relay import Relay

SECONDS = float(os.environ.get("MAVPROXY_S", "3600"))
CUT, JOIN = "link cut", "link joined"
HEAD = "QGC WPL 110"


def plan(*rows):
    """Return a plan file of rows: command, north and east of the start in 0.001 degrees, first parameter."""
    items = [
        f"{n}\t0\t3\t{command}\t{first}\t0\t0\t0\t{START_LATITUDE_DEG + north / 1e3:.7f}"
        f"\t{START_LONGITUDE_DEG + east / 1e3:.7f}\t0\t1"
        for n, (command, north, east, first) in enumerate(rows)
    ]
    return "\n".join([HEAD, *items]) + "\n"


FILES = {
    "mission.txt": plan((16, 0, 0, 0), (16, 2, 0, 0), (16, 2, 2, 0), (16, 0, 2, 0)),
    "fence.txt": plan(*((5001, north, east, 4) for north, east in ((-20, -20), (20, -20), (20, 20), (-20, 20)))),
    "rally.txt": plan((5100, 1, 1, 0), (5100, -1, 1, 0)),
}
OPERATION = (
    "param show CTL_K1", "param set CTL_K1 37.5", "param show CTL_K1", "param set CTL_K2 1e30", "param set NO_SUCH 1",
    "arm uncheck all", "param save all.parm", "param set CTL_K1 40", "param load all.parm",
    "bat", "time", "version", "link", "status GPS_RAW_INT", "servo set 1 1500",
    "mode HOLD", "mode STEERING", "mode MANUAL", "mode LOITER", "mode GUIDED", "setyaw 20 0 0", "setyaw 30 0 1",
    "setspeed 0.4", "mode ACRO",
    "wp load mission.txt", "wp list", "wp status", "mode AUTO", "wp set 2", "wp set 99", "wp save saved.txt",
    "fence load fence.txt", "fence list", "fence enable", "fence status", "fence disable",
    "rally load rally.txt", "rally list", "rally status", "wp set 1", "mode RTL",
    CUT, JOIN,
    "mode GUIDED", "guided 36.002 121.002 0", "disarm", "arm list", "arm prearms", "arm throttle", "magcal start",
    "magcal accept", "magcal cancel", "rc 1 1600", "rc 1 0", "ftp list", "log list", "log download 0 first.bin",
    "reboot", "disarm", "reboot", "log list", "mode GUIDED", "arm throttle", "setyaw 120 0 0", "mode AUTO",
    "wp clear", "mode AUTO", "mode GUIDED", "fence clear", "rally clear", "wp list", "fence list", "rally list",
    "param fetch",
)  # fmt: skip
MODES = [
    *("GUIDED", "HOLD", "STEERING", "MANUAL", "LOITER", "GUIDED", "AUTO", "RTL", "GUIDED"),
    *("HOLD", "GUIDED", "AUTO", "GUIDED"),
]
ARMING = ["ARMED", "DISARMED", "ARMED", "DISARMED", "ARMED"]
REAL, WHEN = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", r"\w{3} \w{3} [ \d]\d \d\d:\d\d:\d\d \d{4}"
PLAN = "(?:waypoints|fence items|rally items)"
KNOWN_LINES = (
    # of MAVProxy about itself
    r"", r"Connect udpin:127\.0\.0\.1:\d+ source_system=255", r"Log Directory: \S+", r"Telemetry log: \S+",
    r"Waiting for heartbeat from 127\.0\.0\.1:\d+", r"Unloading module \w+", r"Requested parameter list \(ftp\)",
    rf"Requesting \d+ {PLAN} t={WHEN} now={WHEN}", r"Requesting log list", r"Downloading log 0 as first\.bin",
    # received from the boat
    r"Detected vehicle 1:1 on link 0", r"online system 1", r"(?:DIS)?ARMED", r"Mode [A-Z]+", r"GPS lock at 2 meters",
    r"Received \d+ parameters \(ftp\)", r"Saved \d+ (?:parameters|defaults) to \S+",
    r"CTL_K1 +(?:40|37\.5)(?:\.0)?", r"Failed to set CTL_K2 to 1e30 \(invalid returned value 0\.3\d*\)",
    r"Unable to find parameter 'NO_SUCH'", r"Failed to set ARMING_CHECK to 0 \(invalid returned value 1(?:\.0)?\)",
    r"Loaded \d+ parameters from all\.parm \(changed 1\)",
    r"changed CTL_K1 from 40\.0+ to 37\.50*", r"No battery information",
    rf"{WHEN} \({WHEN}\)", r"link 1 OK \(\d+ packets, \d+ bytes, 0\.\d\ds delay, \d+ lost, 0\.0% loss, rate:\d+B/s\)",
    r"\d+: GPS_RAW_INT \{time_usec : \d+, fix_type : 3, lat : 36\d{7}, lon : 121\d{7}, alt : 2000, .*\}",
    r"Got COMMAND_ACK: (?:DO_SET_MODE|CONDITION_YAW|DO_CHANGE_SPEED|DO_SET_MISSION_CURRENT|DO_REPOSITION): ACCEPTED",
    r"Got COMMAND_ACK: (?:DO_FENCE_ENABLE|COMPONENT_ARM_DISARM|RUN_PREARM_CHECKS): ACCEPTED",
    r"Got COMMAND_ACK: (?:DO_START_MAG_CAL|DO_CANCEL_MAG_CAL|PREFLIGHT_REBOOT_SHUTDOWN): ACCEPTED",
    r"Got COMMAND_ACK: DO_SET_MODE: (?:DENIED|TEMPORARILY_REJECTED)",
    r"Got COMMAND_ACK: DO_SET_SERVO: TEMPORARILY_REJECTED",
    r"Got COMMAND_ACK: (?:DO_ACCEPT_MAG_CAL|PREFLIGHT_REBOOT_SHUTDOWN): TEMPORARILY_REJECTED",
    r"Got COMMAND_ACK: DO_SET_MISSION_CURRENT: FAILED", r"Got MISSION_ACK: TYPE_(?:MISSION|FENCE|RALLY): ACCEPTED",
    rf"Loaded [24] {PLAN} (?:from (?:mission|fence|rally)\.txt|in \d\.\d\ds)", rf"Sent all [24] {PLAN}",
    rf"(?:16|5001|5100) [03] (?:35\.9|36\.0)\d+ 12[01]\.\d+ {REAL} p1={REAL} p2=0\.0 p3=0\.0 p4=0\.0 cur=[01] auto=1",
    rf"Saved (?:[24] )?{PLAN} to \S+", rf"Have ([24]) of \1 {PLAN}", r"waypoint [0-3]",
    r"fence (?:present|enabled|disabled|removed)", r"ANGLE (?:20|30|120)\.0", r"SPEED 0\.4",
    r"Guided \(36\.002, 121\.002\) 0\.0 frame 3", r"all", r"no link", r"link 1 (?:down|OK)", r"heartbeat OK",
    r"Listing /", r" D (?:@MISSION|@PARAM|logs|metadata|uploads)", r"   parameters\.param\t\d+\t-", r"Total size .*",
    rf"Log [01]  numLogs [12] lastLog [01] size \d+ {WHEN}",
    r"Finished downloading first\.bin \(\d+ bytes .* retries\)",
    # metres to the waypoint; after the restart, which takes seconds on a busy machine
    r"\d{1,2}00", r"Time has wrapped(?: \d+ \d+)?", r"GPS (?:fix lost|OK)",
    # texts of the boat
    r"AP: CTL_K2: 1e\+30 is out of range; allowed: 0 to 50", r"AP: ARMING_CHECK is read-only", r"AP: Mode [A-Z]+",
    r"AP: (?:Disa|A)rmed", r"AP: Speed command ignored: a wave glider cannot set its speed",
    r"AP: Mode 1 is not known; there are MANUAL 0, STEERING 3, HOLD 4, LOITER 5, AUTO 10, RTL 11, GUIDED 15",
    r"AP: New mission: items 1 to 3", r"AP: New (?:fence: 4|rally points: 2) items", r"AP: Mission: item [123]",
    r"AP: Mission complete: keeping station", r"AP: DO_SET_MISSION_CURRENT: the mission has no such item",
    r"AP: Fence (?:enabled|disabled)", r"AP: (?:Mission|Fence|Rally points) cleared", r"AP: PreArm: all good",
    r"AP: Compass swing: sail all headings, 15 min each, then accept",
    r"AP: Compass swing: nothing to accept, \d+ percent of it is done",
    r"AP: Compass swing: cancelled, nothing was set",
    r"AP: RC override ignored in GUIDED: channel 1 is the rudder in MANUAL, the heading in STEERING",
    r"AP: Restart refused: armed", r"AP: Bench rudder refused: armed",
    r"AP: Mission unusable: keeping station", r"AP: Mission problem cleared",
    r"AP: Heading source: compass A", r"AP: AUTO refused: .*mission.*",
    r"AP: Control loop is (?:late|in time again)", r"AP: Ground station (?:silent|heard again)",
)  # fmt: skip


def lines_of(text):
    """Return the lines of a console without the prompts."""
    prompt = re.compile(r"^(?:[A-Z]+> ?)+")
    return [prompt.sub("", line).rstrip() for line in text.splitlines()]


@pytest.mark.proof
@pytest.mark.timeout(2 * 3600 + 300)
def test_mavproxy_writes_only_known_lines_in_an_hour(tmp_path, start_hil, mavproxy):
    hil = start_hil("udpout", scenario="sea", nimble=False, seconds=int(SECONDS) + 600)
    (port,) = unused_ports(["udpin"])
    with Relay(port, 1, share=0.0, port=hil.ports[0]) as relay:
        client = mavproxy(port)
        for name, text in FILES.items():
            (tmp_path / "home" / name).write_text(text)
        client.expect("Saved .* parameters")
        for line in OPERATION:
            relay.cut = line == CUT or (relay.cut and line != JOIN)
            if line not in (CUT, JOIN):
                client.say(line)
            time.sleep(SECONDS / len(OPERATION))
        client.hang_up()
        client.exit_code()
    hil.end()
    all_lines = lines_of(client.text())
    lines = list(dict.fromkeys(all_lines))
    print("\n".join(lines))
    print(f"{len(all_lines)} lines, {len(lines)} different ones")
    assert [line[5:] for line in all_lines if line.startswith("Mode ")] == MODES
    assert [line for line in all_lines if line in ("ARMED", "DISARMED")] == ARMING
    unknown = [line for line in lines if not any(re.fullmatch(known, line) for known in KNOWN_LINES)]
    assert unknown == []
