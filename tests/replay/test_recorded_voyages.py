"""All quantities that a tick computes are those of the recorded voyages: estimates, guidance, faults, modes, energy.

The replay of the other logs compares rudder commands. Many quantities have no effect on them, or only much later: a
position in the log of ArduPilot's format, the energy of the servo, the distance to a vessel. So these logs are computed
again from their inputs, and each message of the new log is compared with the recorded one. Texts are not compared, nor
messages and columns that only one of the two logs has. After an intended change, relog.py computes the logs again.
"""

import gzip
import math
import struct

import pytest

from replay.relog import recompute_log
from replay.voyages import VOYAGES

# DataFlash format character -> code of the struct module.
STRUCT_CODES = {
    "a": "64s", "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "n": "4s", "N": "16s",
    "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q", "Q": "Q", "g": "e",
}  # fmt: skip
FMT_TYPE = 128  # message type of the FMT messages, which define the others
NOT_COMPARED = {"FMT", "FMTU", "UNIT", "MULT", "CHK", "END", "VER", "PARM"}
NAMES = sorted(path.name.removesuffix(".BIN.gz") for path in VOYAGES.glob("*.BIN.gz"))


def messages_of(log):
    """Return the messages of a DataFlash log by name, as lists of columns by label."""
    formats, messages, offset = {FMT_TYPE: ("FMT", struct.Struct("<BB4s16s64s"), ())}, {}, 0
    while offset < len(log):
        assert log[offset : offset + 2] == b"\xa3\x95"
        name, layout, labels = formats[log[offset + 2]]
        values = layout.unpack_from(log, offset + 3)
        offset += 3 + layout.size
        if name == "FMT":
            number, _, *texts = values
            new_name, characters, new_labels = (text.rstrip(b"\0").decode() for text in texts)
            new_layout = struct.Struct("<" + "".join(STRUCT_CODES[character] for character in characters))
            formats[number] = (new_name, new_layout, tuple(new_labels.split(",")))
            messages.setdefault(new_name, [])
        elif name not in NOT_COMPARED:
            messages[name].append(dict(zip(labels, values, strict=True)))
    return messages


def is_same(one, other):
    """Return whether two values are the same, apart from the last digits of the functions of another C library."""
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-6, abs_tol=1e-9) or (math.isnan(one) and math.isnan(other))
    return one == other


def differences(recorded, recomputed):
    for name in recorded.keys() & recomputed.keys():
        if len(recorded[name]) != len(recomputed[name]):
            yield f"{name}: {len(recorded[name])} messages, recomputed {len(recomputed[name])}"
        for row, other in zip(recorded[name], recomputed[name], strict=False):
            for label in row.keys() & other.keys() - {"Message"}:
                if not is_same(row[label], other[label]):
                    yield f"{name}.{label} at {row['TimeUS'] / 1e6} s: {row[label]}, recomputed {other[label]}"


@pytest.mark.parametrize("name", NAMES)
def test_voyage_is_recomputed_with_the_same_messages(name):
    log = gzip.decompress((VOYAGES / f"{name}.BIN.gz").read_bytes())
    again, changed_count, notes = recompute_log(log)
    assert (changed_count, notes) == (0, ())
    assert next(differences(messages_of(log), messages_of(again)), None) is None


def test_voyages_have_all_modes_and_most_faults():
    modes, faults = set(), 0
    for name in NAMES:
        for row in messages_of(gzip.decompress((VOYAGES / f"{name}.BIN.gz").read_bytes()))["CTL"]:
            modes.add(row["Mode"])
            faults |= row["Flt"]
    assert len(modes) == 7
    assert faults.bit_count() >= 25
