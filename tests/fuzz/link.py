"""Every service of the link, with any frames of two stations, and ticks.

The first byte of an input configures the link (`boat.Boat`). Each record after it is a frame of a message, raw bytes,
or a tick of the autopilot.
"""

import tempfile
from functools import partial
from pathlib import Path

from fuzz.boat import LOG, PARAMETERS, SECRET, Boat
from fuzz.target import Target, records

# Bits of the kind of a record; the others are the index of a message of the target or of another action.
ACTION_MASK, OTHER_STATION, SIGNED, LATE = 0x1F, 0x20, 0x40, 0x80
OTHER_ACTIONS = ("bytes", "tick", "later")


def unwritable_files(root):
    """Return all files except uploads and logs, which stations may change."""
    return {
        path.relative_to(root): path.read_bytes() if path.is_file() else None
        for path in root.rglob("*")
        if "uploads" not in path.relative_to(root).parts and path.suffix != ".BIN"
    }


def play(numbers, boat, data):
    for kind, body in records(data):
        action = (kind & ACTION_MASK) % (len(numbers) + len(OTHER_ACTIONS))
        station = "two" if kind & OTHER_STATION else "one"
        if action < len(numbers):
            signed = bool(kind & SIGNED)
            frame = boat.frame(numbers[action], body, station, signed=signed, late=bool(kind & LATE))
            boat.receive(frame, station, signed=signed)
        elif action == len(numbers):
            boat.receive(body, station, signed=False)
        elif action == len(numbers) + 1:
            boat.tick(0.1, body[0] if body else 0)
        else:
            boat.tick(float(body[0]) if body else 1.0)
    boat.end()


def run(numbers, data, *, with_files=False):
    setup, records_data = (data[0], data[1:]) if data else (0, b"")
    if not with_files:
        play(numbers, Boat(setup), records_data)
        return
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        boat = Boat(setup, root)
        previous = unwritable_files(root)
        play(numbers, boat, records_data)
        assert unwritable_files(root) == previous
        assert all(LOG.startswith(path.read_bytes()) for path in (root / "logs").iterdir())


def run_bytes(data):
    """Send raw bytes to the link in pieces of any size."""
    boat = Boat(data[0] if data else 0)
    for _, body in records(data[1:]):
        boat.receive(body, "one", signed=False)
        assert all(len(peer.splitter._buffer) <= 280 for peer in boat.endpoint._peers)
    boat.end()


# Message numbers of each service. Add new ones at the end of a row: the corpus contains their positions.
MESSAGES = {
    "commands": (76, 75, 80, 11, 66),
    "parameters": (20, 21, 23, 320, 321, 323),
    "mission": (44, 73, 39, 45, 43, 51, 40, 37, 38, 41, 47, 76),
    "files": (110,),
    "logs": (117, 119, 121, 122),
    "signing": (256, 76, 0, 23, 111),
    "timesync": (111, 4, 2, 0),
    "setpoints": (86, 84, 82, 76, 243),
    "manual": (69, 70, 76, 11, 147),
    "radio": (109, 66, 0),
    "shell": (126, 0),
}
NAMES = tuple(row.name.encode() for row in PARAMETERS)
PATHS = (
    b"@PARAM/param.pck", b"@MISSION/mission.dat", b"@MISSION/fence.dat", b"@MISSION/rally.dat", b"logs/00000001.BIN",
    b"uploads/a", b"uploads/link/secret", b"/uploads/..", b"?start=1&count=9", b"&withdefaults=1", b"parameters.param",
)  # fmt: skip
WORDS = {"parameters": NAMES, "files": PATHS, "signing": (SECRET,)}
TARGETS = {
    f"link_{name}": Target(partial(run, numbers, with_files=name in ("files", "logs")), words=WORDS.get(name, ()))
    for name, numbers in MESSAGES.items()
} | {"link_bytes": Target(run_bytes)}


def handled_numbers():
    """Return the numbers of all messages that the link handles."""
    return set(Boat(0).endpoint.handlers)
