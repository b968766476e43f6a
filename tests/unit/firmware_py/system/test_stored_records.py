"""Records of other versions: a field that was added, removed or renamed does not affect the others."""

from copy import deepcopy
from dataclasses import dataclass

import msgspec
import pytest

from firmware_py.common import record_codec
from firmware_py.link.satellite import record as satellite
from firmware_py.link.satellite.messages import Window
from firmware_py.link.satellite.record import Ledger
from firmware_py.system import endings
from firmware_py.system.endings import Ending, Endings


@dataclass(frozen=True)
class StoredRecord:
    """A record with every field filled, its module, and the paths of its fields."""

    module: object
    record: msgspec.Struct
    paths: tuple[tuple[object, ...], ...]

    def plain(self):
        return msgspec.msgpack.decode(self.module.to_bytes(self.record))

    def decode(self, plain):
        """Return the plain form of the decoded record, and the notes."""
        record, notes = self.module.from_bytes(msgspec.msgpack.encode(plain))
        return msgspec.msgpack.decode(self.module.to_bytes(record)), notes


RECORDS = [
    StoredRecord(
        endings,
        Endings({"killed": 2}, (Ending("killed", "SIGKILL", 1.8e9),), running=True),
        (("counts",), ("last",), ("running",), ("last", 0, "text"), ("last", 0, "utc_s")),
    ),
    StoredRecord(
        satellite,
        satellite.Record(Ledger(20600, 676, 3, 41, 250), Window(7, (9,)), ((7, 123456),)),
        (
            *(("ledger",), ("window",), ("seen",), ("window", "floor"), ("window", "used")),
            *(("ledger", name) for name in ("day", "month", "day_used", "month_used", "total")),
        ),
    ),
]
STRUCTS = {"window": "Window", "ledger": "Ledger", "last": "Ending"}
each_record = pytest.mark.parametrize("stored", RECORDS, ids=lambda stored: type(stored.record).__name__)
each_field = pytest.mark.parametrize(
    ("stored", "path"),
    [pytest.param(stored, path, id=".".join(map(str, path))) for stored in RECORDS for path in stored.paths],
)


def parent_of(plain, path):
    """Return the part of a plain record that contains the field."""
    for key in path[:-1]:
        plain = plain[key]
    return plain


@each_field
def test_an_added_field_has_its_default(stored, path):
    plain = stored.plain()
    value = parent_of(plain, path).pop(path[-1])
    decoded, notes = stored.decode(plain)
    default = parent_of(decoded, path).pop(path[-1])
    assert (decoded, notes) == (plain, ())
    assert default != value


@each_field
def test_a_removed_field_is_ignored_and_reported(stored, path):
    plain = stored.plain()
    parent_of(plain, path)["tide_m"] = 1.5
    decoded, (note,) = stored.decode(plain)
    assert decoded == stored.plain()
    assert note.endswith(": field 'tide_m' is not known here, ignored")


@each_field
def test_a_renamed_field_is_reported_or_read_by_its_former_name(stored, path, monkeypatch):
    plain, without_field = stored.plain(), stored.plain()
    parent_of(without_field, path).pop(path[-1])
    parent = parent_of(plain, path)
    parent["former"] = parent.pop(path[-1])
    decoded, (note,) = stored.decode(deepcopy(plain))
    assert decoded == stored.decode(without_field)[0]
    assert note.endswith(": field 'former' is not known here, ignored")
    struct = STRUCTS[path[0]] if len(path) > 1 else type(stored.record).__name__
    monkeypatch.setitem(record_codec.FORMER_NAMES, struct, {"former": path[-1]})
    assert stored.decode(plain) == (stored.plain(), ())


@each_record
def test_a_record_of_a_later_version_is_read_and_reported(stored):
    plain = stored.plain()
    decoded, (note,) = stored.decode({**plain, "version": plain["version"] + 1})
    assert decoded == plain
    assert "written by a later version" in note


@each_record
def test_a_truncated_record_is_refused(stored):
    content = stored.module.to_bytes(stored.record)
    for length in range(len(content)):
        with pytest.raises(ValueError):
            stored.module.from_bytes(content[:length])


@pytest.mark.parametrize(
    "record",
    [
        satellite.Record(Ledger(day_used=-1)),
        *(satellite.Record(window=window) for window in (Window(-1), Window(7, (9, 8)), Window(7, (9, 9)))),
    ],
)
def test_impossible_counts_of_a_satellite_link_are_refused(record):
    with pytest.raises(ValueError, match="negative, or the numbers are not in order"):
        satellite.from_bytes(satellite.to_bytes(record))
