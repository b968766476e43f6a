"""A record of another version: a field that was added, removed or renamed since leaves the others as they are."""

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
class Kept:
    """A record with every field filled, and the paths of all fields in its plain form."""

    module: object
    record: msgspec.Struct
    paths: tuple[tuple[object, ...], ...]


KEPT = [
    Kept(
        endings,
        Endings({"killed": 2}, (Ending("killed", "SIGKILL", 1.8e9),), running=True),
        (("counts",), ("last",), ("running",), ("last", 0, "text"), ("last", 0, "utc_s")),
    ),
    Kept(
        satellite,
        satellite.Record(Ledger(20600, 676, 3, 41, 250), Window(7, (9,)), ((7, 123456),)),
        (
            *(("ledger",), ("window",), ("seen",), ("window", "floor"), ("window", "used")),
            *(("ledger", name) for name in ("day", "month", "day_used", "month_used", "total")),
        ),
    ),
]
CASES = [pytest.param(kept, path, id=".".join(map(str, path))) for kept in KEPT for path in kept.paths]


def plain_of(kept):
    return msgspec.msgpack.decode(kept.module.to_bytes(kept.record))


def holder_of(plain, path):
    for part in path[:-1]:
        plain = plain[part]
    return plain


def read(kept, plain):
    record, notes = kept.module.from_bytes(msgspec.msgpack.encode(plain))
    return plain_of(Kept(kept.module, record, ())), notes


@pytest.mark.parametrize(("kept", "path"), CASES)
def test_a_field_that_this_version_has_added_takes_its_default(kept, path):
    plain = plain_of(kept)
    value = holder_of(plain, path).pop(path[-1])
    found, notes = read(kept, plain)
    default = holder_of(found, path).pop(path[-1])
    assert (found, notes) == (plain, ())
    assert default != value


@pytest.mark.parametrize(("kept", "path"), CASES)
def test_a_field_that_this_version_has_removed_is_ignored_and_reported(kept, path):
    plain = plain_of(kept)
    wanted = deepcopy(plain)
    holder_of(plain, path)["tide_m"] = 1.5
    found, (note,) = read(kept, plain)
    assert found == wanted
    assert note.endswith(": field 'tide_m' is not known here, ignored")


@pytest.mark.parametrize(("kept", "path"), CASES)
def test_a_field_that_this_version_has_renamed_is_found_or_reported(kept, path, monkeypatch):
    plain = plain_of(kept)
    wanted, bare = deepcopy(plain), deepcopy(plain)
    holder_of(bare, path).pop(path[-1])
    holder = holder_of(plain, path)
    holder["former"] = holder.pop(path[-1])
    found, (note,) = read(kept, deepcopy(plain))
    assert found == read(kept, bare)[0]
    assert note.endswith(": field 'former' is not known here, ignored")
    names = {"window": "Window", "ledger": "Ledger", "last": "Ending"}
    kind = names[path[0]] if len(path) > 1 else type(kept.record).__name__
    monkeypatch.setitem(record_codec.FORMER_NAMES, kind, {"former": path[-1]})
    assert read(kept, plain) == (wanted, ())


@pytest.mark.parametrize("kept", KEPT, ids=lambda kept: type(kept.record).__name__)
def test_a_record_of_a_later_version_is_read_by_name_and_reported(kept):
    plain = plain_of(kept)
    found, (note,) = read(kept, {**plain, "version": plain["version"] + 1})
    assert found == plain
    assert "written by a later version" in note


@pytest.mark.parametrize("kept", KEPT, ids=lambda kept: type(kept.record).__name__)
def test_a_record_that_was_cut_off_or_changed_is_refused(kept):
    content = kept.module.to_bytes(kept.record)
    for length in range(len(content)):
        with pytest.raises(ValueError):
            kept.module.from_bytes(content[:length])


@pytest.mark.parametrize(
    "record",
    [
        satellite.Record(Ledger(day_used=-1)),
        satellite.Record(window=Window(-1)),
        satellite.Record(window=Window(7, (9, 8))),
        satellite.Record(window=Window(7, (9, 9))),
    ],
)
def test_counts_that_no_satellite_link_can_have_are_refused(record):
    with pytest.raises(ValueError, match="negative, or the numbers are not in order"):
        satellite.from_bytes(satellite.to_bytes(record))
