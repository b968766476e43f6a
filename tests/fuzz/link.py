"""Every service of the link: any frames, two stations, ticks.

The first byte of an input sets the link up (`boat.Boat`); each record behind it is a frame of one message, or bytes,
or something that happens on board.
"""

import tempfile
from functools import partial
from pathlib import Path

from fuzz.boat import LOG, PARAMETERS, SECRET, Boat
from fuzz.target import Target, records

# Bits of a record's kind; the rest is the number of what it is, in the order of the target's messages.
WHAT, OTHER_STATION, SIGNED, LATE = 0x1F, 0x20, 0x40, 0x80
AFTER_MESSAGES = ("bytes", "tick", "later")


def outside(root):
    """All files but the uploads and the logs, which may be erased."""
    return {
        path.relative_to(root): path.read_bytes() if path.is_file() else None
        for path in root.rglob("*")
        if "uploads" not in path.relative_to(root).parts and path.suffix != ".BIN"
    }


def play(numbers, boat, data):
    for kind, body in records(data):
        what = (kind & WHAT) % (len(numbers) + len(AFTER_MESSAGES))
        station = "two" if kind & OTHER_STATION else "one"
        if what < len(numbers):
            signed = bool(kind & SIGNED)
            frame = boat.frame(numbers[what], body, station, signed=signed, late=bool(kind & LATE))
            boat.hear(frame, station, signed=signed)
        elif what == len(numbers):
            boat.hear(body, station, signed=False)
        elif what == len(numbers) + 1:
            boat.tick(0.1, body[0] if body else 0)
        else:
            boat.tick(float(body[0]) if body else 1.0)
    boat.end()


def run(numbers, data, *, files=False):
    setup, rest = (data[0], data[1:]) if data else (0, b"")
    if not files:
        play(numbers, Boat(setup), rest)
        return
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        boat = Boat(setup, root)
        before = outside(root)
        play(numbers, boat, rest)
        assert outside(root) == before
        assert all(LOG.startswith(path.read_bytes()) for path in (root / "logs").iterdir())


def run_bytes(data):
    """Give the link bytes, in pieces of any size, and no more."""
    boat = Boat(data[0] if data else 0)
    for _, body in records(data[1:]):
        boat.hear(body, "one", signed=False)
        assert all(len(peer.splitter._held) <= 280 for peer in boat.endpoint._peers)
    boat.end()


# What each service hears; at the end of a row new ones may be added, the corpus counts them from the front.
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
    b"uploads/a", b"uploads/way/secret", b"/uploads/..", b"?start=1&count=9", b"&withdefaults=1", b"parameters.param",
)  # fmt: skip
WORDS = {"parameters": NAMES, "files": PATHS, "signing": (SECRET,)}
TARGETS = {
    f"link_{name}": Target(partial(run, numbers, files=name in ("files", "logs")), words=WORDS.get(name, ()))
    for name, numbers in MESSAGES.items()
} | {"link_bytes": Target(run_bytes)}


def handled_messages():
    """The numbers of all messages that the link hears."""
    return set(Boat(0).endpoint.handlers)
