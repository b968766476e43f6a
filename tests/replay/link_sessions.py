"""Record the sessions of data/links/: what the link sends during a voyage, and its replies to a dialogue.

.venv/bin/python tests/replay/link_sessions.py

A session is a list of messages in the order of sending, decoded by pymavlink: [time, fields]. Run this after an
intended change of a message and look at the difference: ground stations read these numbers.
"""

import gzip
import json
import math
import sys
from pathlib import Path

import msgspec
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, Verdict
from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import as_plain
from firmware_py.core.state_codec import state_from_text
from firmware_py.core.step import step
from firmware_py.log.reader import read_log
from firmware_py.plans.items import Command
from replay.voyages import VOYAGES
from support.link import Rig
from support.plans import item

LINKS = Path(__file__).parent / "data" / "links"
NOT_COMPARED = {"text", "param_index", "param_count"}  # wording, and the size of the parameter table
INTERVAL_S = 15.0  # of the ticks of a voyage that the link publishes
MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255  # MAV_MISSION_TYPE_...
REAL32, INT32 = mavlink.MAV_PARAM_TYPE_REAL32, mavlink.MAV_PARAM_TYPE_INT32
SET_INTERVAL, REQUEST_MESSAGE = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_REQUEST_MESSAGE
# Numbers of commands (MAV_CMD) and messages when the sessions were recorded; later ones do not change a session.
COMMANDS = (
    17, 20, 115, 176, 178, 179, 183, 192, 193, 207, 213, 224, 241, 245, 246, 262, 300, 400, 401, 410, 510, 511, 512,
    519, 520, 2600, 42006, 42424, 42425, 42426, 42428, 43002,
)  # fmt: skip
TELEMETRY = (
    1, 2, 24, 30, 31, 32, 33, 36, 42, 49, 62, 65, 74, 83, 87, 147, 162, 191, 192, 193, 230, 235, 242, 245, 251, 301,
    436, 437,
)  # fmt: skip
# Parameters of commands: usual numbers, and numbers that most commands refuse.
CHOICES = (
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (1.0, 2.0, 1.0, 0.0, 36.01, 121.02, 3.0),
    (90.0, 5.0, -1.0, 1.0, -10.0, 170.0, 0.0),
    (-1.0, -1.0, -1.0, -1.0, 91.0, 181.0, -1.0),
    (2.0, 1600.0, 3.0, 4.0, 5.0, 6.0, 7.0),
    (-10.0, 0.0, 0.0, 0.0, -91.0, 10.0, 0.0),
    (-10.0, 0.0, 0.0, 1.0, 10.0, -181.0, 0.0),
    (-10.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0),
    (10.0, 0.0, -1.0, 1.0, 0.0, 1.0, 0.0),
    (361.0, 1.0, 0.5, 0.5, 0.5, 0.5, 0.5),
    (0.5, 0.5, 2.0, 2.0, 36.0, 121.0, 1e5),
    (0.0, 4.0, 0.0, 0.0, 0.0, 0.0, 20190226.0),
    (1.0, 21196.0, 0.0, 0.0, 0.0, 20190226.0, 0.0),
    (129.0, 15.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (math.nan,) * 7,
    (300.0, 300.0, 300.0, 300.0, 300.0, 300.0, 300.0),
)


class Session:
    """A rig whose messages are recorded."""

    def __init__(self, **options):
        self.rig = Rig(**options)
        self.lines = []

    def note(self, messages):
        for message in messages:
            fields = message.to_dict()
            for name in NOT_COMPARED & fields.keys():
                del fields[name]
            self.lines.append([round(self.rig.now_s, 3), plain(fields)])

    def send(self, *messages, address="station"):
        self.note(self.rig.send(*messages, address=address))

    def tick(self, **changes):
        self.note(self.rig.tick(**changes))

    def note_intents(self):
        for intent in self.rig.request_handler.intents:
            self.lines.append(
                [
                    round(self.rig.now_s, 3),
                    {"intent": type(intent).__name__} | plain(msgspec.to_builtins(intent, enc_hook=as_plain)),
                ]
            )
        self.rig.request_handler.requests.clear()


def plain(fields):
    """Return fields as JSON data, without NaN."""

    def convert(value):
        if isinstance(value, float):
            return value if math.isfinite(value) else str(value)
        if isinstance(value, dict):
            return {str(name): convert(part) for name, part in value.items()}
        if isinstance(value, (list, tuple)):
            return [convert(part) for part in value]
        if isinstance(value, (bytes, bytearray)):
            return value.hex()
        return value

    return convert(fields)


def watch_voyage(name):
    """Return the messages of a link during a voyage: each telemetry message whenever it is due."""
    session, state = Session(), None
    heartbeat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0, 3)
    session.rig.send(heartbeat)
    for number in TELEMETRY:
        session.rig.send(command(SET_INTERVAL, number, 1e6 * INTERVAL_S))
    session.rig.replies()
    for tick in read_log(gzip.decompress((VOYAGES / f"{name}.BIN.gz").read_bytes())):
        if state is None:
            state, _ = state_from_text(tick.checkpoint)
        state, output = step(state, tick.inputs)
        if output.events or tick.inputs.tick.t_s % INTERVAL_S == 0.0:
            session.rig.now_s = tick.inputs.tick.t_s
            session.rig.endpoint.publish(output, session.rig.now_s)
            session.note(session.rig.replies())
    return session.lines


def command(number, *values, confirmation=0):
    values = (*values, *(0.0,) * (7 - len(values)))
    return mavlink.MAVLink_command_long_message(1, 1, number, confirmation, *values)


def mission_item(sequence, source, kind):
    return mavlink.MAVLink_mission_item_int_message(
        1,
        1,
        sequence,
        source.frame,
        source.command,
        0,
        source.autocontinue,
        *source.params,
        source.x,
        source.y,
        0,
        kind,
    )


def upload(session, kind, items):
    """Upload a plan; the first item of a mission is home."""
    session.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), kind))
    for sequence, source in enumerate(items):
        session.send(mission_item(sequence, source, kind))
    session.note_intents()


# Masks and quaternions of SET_ATTITUDE_TARGET: a heading of 45 deg, north, ignored, not of unit length, heeled, odd.
ATTITUDES = (
    (7, (0.9239, 0.0, 0.0, 0.3827)),
    (3, (1.0, 0.0, 0.0, 0.0)),
    (128, (1.0, 0.0, 0.0, 0.0)),
    (7, (0.5, 0.0, 0.0, 0.0)),
    (7, (0.7071, 0.7071, 0.0, 0.0)),
    (0, (0.9, 0.1, 0.1, 0.4)),
)
# MAV_FRAME_...: those of targets, and others.
FRAMES = (0, 1, 5, 6, 7, 8, 9, 11, 12)
# Values of type_mask in SET_POSITION_TARGET_*; a set bit ignores a value.
MASKS = (0, 1479, 2527, 3064, 3559, 3576, 3580, 4088, 2503, 1 << 12, 3527)


def set_targets(session):
    """Send position targets in all frames with the usual masks, and attitude targets."""
    for mask in MASKS:
        for frame in FRAMES:
            session.rig.now_s += 1.0
            rates = (0.5, 0.2, 0.0, 0.0, 0.0, 0.0, 1.0, 0.1)
            session.send(
                mavlink.MAVLink_set_position_target_global_int_message(
                    0, 1, 1, frame, mask, 360_000_000, 1_210_000_000, 0.0, *rates
                ),
                mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, 10.0, 20.0, 0.0, *rates),
            )
            session.note_intents()
    for mask, quaternion in ATTITUDES:
        session.rig.now_s += 1.0
        session.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, quaternion, 0.0, 0.0, 0.1, 0.5))
        session.note_intents()


def send_commands(session):
    """Send every command with every choice of values, as COMMAND_LONG and COMMAND_INT."""
    for number in COMMANDS:
        for values in CHOICES:
            session.rig.now_s += 3.0
            session.send(command(number, *values))
            place = (0 if math.isnan(value) else round(value * 1e7) for value in values[4:6])
            x, y = (min(max(number, -(2**31)), 2**31 - 1) for number in place)
            for frame in (0, 3):
                session.rig.now_s += 3.0
                message = mavlink.MAVLink_command_int_message(
                    1,
                    1,
                    frame,
                    number,
                    0,
                    0,
                    *values[:4],
                    min(max(x, -(2**31)), 2**31 - 1),
                    min(max(y, -(2**31)), 2**31 - 1),
                    values[6],
                )
                session.send(message)
            session.note_intents()
        session.tick()


def transfer_plans(session):
    """Upload, read, select and clear plans of every kind."""
    plans = (
        (
            MISSION,
            (
                item(Command.WAYPOINT, 0, 0),
                item(Command.WAYPOINT, 50, 0, 5),
                item(Command.LOITER_TIME, 50, 50, 60, 0, -30),
                item(Command.JUMP, None, None, 1, 2),
                item(Command.RETURN),
            ),
        ),
        (
            FENCE,
            tuple(
                item(Command.INCLUDED_VERTEX, north_m, east_m, 3)
                for north_m, east_m in ((-90, -90), (90, 0), (-90, 90))
            ),
        ),
        (
            FENCE,
            (
                item(Command.INCLUDED_CIRCLE, 0, 0, 500),
                item(Command.EXCLUDED_CIRCLE, 100, 100, 20),
                item(Command.FENCE_RETURN, 10, 0),
            ),
        ),
        (RALLY, (item(Command.RALLY_POINT, 30, 30),)),
        (MISSION, (item(Command.WAYPOINT, 0, 0), item(Command.WAYPOINT, 50, 0, -5.0), item(9999, 50, 50))),
    )
    for kind, items in plans:
        session.rig.now_s += 3.0
        upload(session, kind, items)
        session.send(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
        for sequence in range(len(items) + 1):
            session.send(mavlink.MAVLink_mission_request_int_message(1, 1, sequence, kind))
            session.send(mavlink.MAVLink_mission_request_message(1, 1, sequence, kind))
        session.send(mavlink.MAVLink_mission_request_partial_list_message(1, 1, 0, 2, kind))
        session.send(mavlink.MAVLink_mission_set_current_message(1, 1, 1))
        session.tick()
        session.note_intents()
    for kind in (MISSION, FENCE, RALLY, ALL):
        session.rig.now_s += 3.0
        session.send(mavlink.MAVLink_mission_clear_all_message(1, 1, kind))


def send_parameters_and_sticks(session):
    """Set parameters, setpoints and sticks."""
    for name, value, kind in (
        (b"CTL_K1", 41.0, REAL32),
        (b"LOOP_RATE_HZ", 7.0, INT32),
        (b"CTL_K1", 999.0, REAL32),
        (b"NOPE", 1.0, REAL32),
    ):
        session.send(mavlink.MAVLink_param_set_message(1, 1, name, value, kind))
        session.send(mavlink.MAVLink_param_request_read_message(1, 1, name, -1))
    set_targets(session)
    for x, y, r in ((500, 0, -300), (32767, 32767, 32767), (0, 1000, 1000), (0, 32767, 400), (-1000, -250, 32767)):
        session.send(mavlink.MAVLink_manual_control_message(1, x, y, 0, r, 0))
        session.send(mavlink.MAVLink_rc_channels_override_message(1, 1, 1500 + x // 100, 0, 0, 1500, 0, 0, 0, 0))
        session.rig.now_s += 1.0
        session.tick()
        session.note_intents()


def talk(verdict):
    """Return the replies to commands, parameters, plans, streams and sticks, with one verdict for all requests."""
    session = Session(addresses=("station", "other"))
    session.rig.request_handler.answer = Answer(verdict, "" if verdict is Verdict.ACCEPTED else "reason")
    session.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0, 3))
    session.tick()
    send_commands(session)
    transfer_plans(session)
    send_parameters_and_sticks(session)
    session.send(
        mavlink.MAVLink_timesync_message(0, 123_456),
        mavlink.MAVLink_ping_message(1, 7, 0, 0),
        mavlink.MAVLink_set_mode_message(1, 1, Mode.GUIDED.value),
        mavlink.MAVLink_request_data_stream_message(1, 1, 10, 4, 1),
        mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF),
    )
    for number in TELEMETRY:
        session.rig.now_s += 0.1
        session.send(command(REQUEST_MESSAGE, number))
    for _ in range(5):
        session.tick(seconds=1.0)
    session.note_intents()
    return session.lines


SESSIONS = {
    **{
        f"voyage_{name}": lambda name=name: watch_voyage(name)
        for name in ("mission", "device_faults", "traffic", "strong_current", "sparse_devices")
    },
    "dialogue_accepted": lambda: talk(Verdict.ACCEPTED),
    "dialogue_refused": lambda: talk(Verdict.TEMPORARILY_REJECTED),
}

if __name__ == "__main__":
    LINKS.mkdir(exist_ok=True)
    for name in sys.argv[1:] or SESSIONS:
        text = "\n".join(json.dumps(line, separators=(",", ":")) for line in SESSIONS[name]()) + "\n"
        (LINKS / f"{name}.jsonl.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
        print(name, len(text))
