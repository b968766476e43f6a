"""The step function with valid parameters at any place of their ranges, and with every kind of compass."""

from firmware_py.common.mode_table import Mode
from fuzz.target import Target, records
from support.corners import COMPASSES, FREE, CheckedBoat, value_at_share

SECONDS = 12.0
MODES = tuple(mode.value for mode in Mode)


def parameter_corners(data):
    """Run with the parameters of the records.

    The first two bytes of the input select compass and mode. The first byte of a record selects the parameter, the
    second its value within the range. A kind of 0x80 or more sets the parameter during the run.
    """
    values, later = {}, {}
    for kind, body in records(data[2:]):
        if len(body) >= 2:
            row = FREE[body[0] % len(FREE)]
            (later if kind & 0x80 else values)[row.name] = value_at_share(row, body[1] / 255)
    compass, mode = (*data[:2], 0, 0)[:2]
    names = tuple(COMPASSES)
    CheckedBoat(values, names[compass % len(names)], later, MODES[mode % len(MODES)]).run(SECONDS)


TARGETS = {"parameter_corners": Target(parameter_corners, max_bytes=128)}
