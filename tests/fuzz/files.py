"""Readers of files: plans, parameters, vehicle files and the files of a state directory."""

import contextlib
import functools
import hashlib
import json
import math
import tempfile
import zlib
from pathlib import Path
from types import SimpleNamespace

from firmware_py.assemble.stored_state import resume
from firmware_py.assemble.wiring import vehicle_parameters
from firmware_py.cli.plan import item_fields
from firmware_py.cli.state import DECODERS, check_contents
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import MAX_PROBLEMS, ParameterSet, format_file, parse_file
from firmware_py.common.plan import PlanKind
from firmware_py.common.plan import from_text as plan_from_text
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.common.records import Stored
from firmware_py.core.state import State
from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from firmware_py.link.signing import KeyState, Signing
from firmware_py.link.wire.urls import LinkError, parse_url
from firmware_py.plans.numbers import PlanFileError
from firmware_py.plans.qgc_file import write_plan
from firmware_py.plans.read_file import read_plan_file
from firmware_py.plans.text_files import write_text
from firmware_py.plans.validation import problem_of
from firmware_py.system.slots import SlotWriter, examine
from firmware_py.system.state_directory import (
    PARAMETER_FILE,
    PLAN_FILES,
    STATE_NAMES,
    StateFiles,
    load_parameters,
    load_plans,
    report_damage,
)
from firmware_py.system.state_export import FORMAT, PENDING_IMPORT, BrokenExportError, unpack
from firmware_py.system.store import finish_import
from firmware_py.vehicle import VehicleError, load
from fuzz.boat import RESUME_TIME, UTC_S, inputs_at
from fuzz.target import Target, check_finite, check_line, float_bits, records
from support.plans import item, mission

FIRST_TICKS = 4


def reads_file(read):
    """Turn a function of a path into a function of the bytes of the file."""

    @functools.wraps(read)
    def run(data):
        with tempfile.TemporaryDirectory() as name:
            path = Path(name) / "file"
            path.write_bytes(data)
            read(path)

    return run


# ------------------------------------------------------------------------------------ plans


def check_plan(plan):
    """Check that an accepted plan is stored and listed without a change."""
    assert problem_of(plan) is None
    assert plan_from_text(plan_to_text(plan)) == (plan, ())
    json.dumps([item_fields(item) for item in plan.items], allow_nan=False)


def plan_file(data):
    """Read a plan file of any kind; the first byte selects whether item 0 is home."""
    plans = {plan.kind: plan for plan in read_plan_file(data[1:], "file", home=not (data[:1] or b"\0")[0] & 1)}
    for plan in plans.values():
        check_plan(plan)
    plans_by_kind = SimpleNamespace(**{kind.name.lower(): plans.get(kind) for kind in PlanKind}, of=plans.get)
    if set(plans) == set(PlanKind):
        decoded = {plan.kind: plan for plan in read_plan_file(write_plan(plans_by_kind).encode(), "again")}
        assert decoded == plans
    for plan in plans.values():
        assert not plan.items or read_plan_file(write_text(plan).encode(), "again") == (plan,)


def stored_plans(data):
    """Read the plans of a state directory; an invalid one is ignored and reported."""
    messages = []
    store = SimpleNamespace(load=dict.fromkeys(PLAN_FILES.values(), data).get)
    plans = load_plans(store, messages.append)
    for line in messages:
        check_line(line)
    for kind in PlanKind:
        check_plan(plans.of(kind))
        assert messages or plans.of(kind).items or not data


# ------------------------------------------------------------------------------- parameters, vehicle


def check_values(values):
    for name, value in values.items():
        assert float_bits(TABLE[INDEX[name]].check(value)) == float_bits(value)


def parameter_file(data):
    """Read a parameter file like `rambler params`, and check that the written file has the same values."""
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        return
    values = parse_file(text, "file")
    check_values(values)
    assert parse_file(format_file(values), "again") == values


def stored_parameters(data):
    """Read the parameters of a state directory; an invalid line is ignored and reported."""
    messages = []
    store = SimpleNamespace(load={PARAMETER_FILE: data}.get)
    usable, unusable = load_parameters(store, messages.append)
    for line in messages:
        check_line(line)
    check_values(usable)
    decoded = SimpleNamespace(load={PARAMETER_FILE: format_file(unusable | usable).encode()}.get)
    assert load_parameters(decoded, messages.append) == (usable, unusable)


@reads_file
def vehicle_file(path):
    vehicle = load(path)
    check_values(vehicle.parameters)
    check_finite(vehicle.hull)
    vehicle_parameters(vehicle)
    for url in vehicle.link_urls:
        link_url(url[:256].encode("utf-8", "surrogatepass"))


def link_url(data):
    url = parse_url(data.decode("utf-8", "replace"))
    assert url.host
    assert 1 <= url.number <= 4_000_000


# ------------------------------------------------------------------------------------ state


def check_ticks(state):
    """Check that a boat with this state runs with finite rudder commands, and that the state is encoded exactly."""
    for index in range(FIRST_TICKS):
        state, output = step(state, inputs_at(index, 0.1 * index))
        check_finite(output.command)
        assert abs(output.command.shaft_rad) <= math.pi
        check_finite(output.snapshot)
        for event in output.events:
            check_line(event.text)
    decoded, notes = state_from_text(state_to_text(state))
    assert notes == ()
    assert state_to_text(decoded) == state_to_text(state)


@functools.cache
def resuming_state():
    values = ParameterSet().replaced("BOOT_RESUME", 2).replaced("BOOT_RESUME_H", 100)
    return State.at_start(values, mission(item(16, 500.0, 0.0), item(19, 500.0, 500.0, 60.0), item(20)))


def resume_file(data):
    """Resume from a record with any content."""
    messages = []
    state = resume(resuming_state(), data, RESUME_TIME, messages.append)
    for line in messages:
        check_line(line)
    check_line(state.greeting)
    check_ticks(state)


def checkpoint(data):
    """Decode the checkpoint of a log of any version, and encode it again."""
    state, notes = state_from_text(data.decode("utf-8", "surrogateescape"))
    for note in notes:
        check_line(note)
    text = state_to_text(state)
    decoded, notes = state_from_text(text)
    assert notes == ()
    assert state_to_text(decoded) == text


def signing_key(data):
    """Restore a stored key. An unreadable one is lost; a new key can be set in any case."""
    saved = []

    def save(content, *, both_slots=False):
        saved.append(content)

    def restore(content):
        signing = Signing(lambda: UTC_S, save)
        state = signing.restore(Stored(content))
        assert signing.has_key == (state is KeyState.PRESENT)
        assert bool(signing.problem) == (state is KeyState.LOST)
        return signing

    signing = restore(data)
    assert signing.has_key or signing.problem or not data
    if signing.has_key:
        signing.store_exactly()
        decoded = restore(saved[-1])
        decoded.store_exactly()
        assert saved[-1] == saved[-2]
        assert signing.set_key(signing._key, 0)
        assert restore(saved[-1]).has_key  # with timestamps after the used ones
    assert signing.set_key(b"k" * 32, 0)
    assert signing.problem == ""
    assert restore(saved[-1]).has_key


def state_import(data):
    """Import any file, and start with the same file as an interrupted import.

    The first byte selects whether the rest gets the header of an export. An unusable import is set aside, and the
    previous state remains.
    """
    body = data[1:]
    if data[:1] != b"\0":
        head = f"# rambler exported state {FORMAT} {len(body)} {hashlib.sha256(body).hexdigest()}\n"
        body = head.encode() + body
    messages = []
    try:
        check_contents(unpack(body), messages.append)
    except BrokenExportError as error:
        messages.append(str(error))
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        writer = SlotWriter(directory, frozenset())
        writer.write(PARAMETER_FILE, b"CTL_K1 3\n")
        writer.close()
        (directory / PENDING_IMPORT).write_bytes(body)
        problem = finish_import(directory)
        assert not (directory / PENDING_IMPORT).exists()
        if problem:
            assert examine(directory, PARAMETER_FILE).content == b"CTL_K1 3\n"
            messages.append(problem)
        store = StateFiles(directory)
        report_damage(store, messages.append)
        check_values(load_parameters(store, messages.append)[0])
        load_plans(store, messages.append)
        for record, read in DECODERS.items():
            with contextlib.suppress(ValueError):
                read(store.load(record) or b"")
    for line in messages:
        check_line(line)


VALID, ABSENT, PADDED = 0x01, 0x02, 0x04


def slots(data):
    """Read two slots with any content, then write: a reader finds the last content."""
    with tempfile.TemporaryDirectory() as name:
        directory, valid_slots = Path(name), {}
        for slot, (kind, body) in zip((0, 1), records(data), strict=False):
            if kind & ABSENT:
                continue
            content = encode_slot(kind >> 4, body) if kind & VALID else body
            (directory / f"name.{slot}").write_bytes(content + (b"\0" * 4096 if kind & PADDED else b""))
            valid_slots[slot] = (kind >> 4, body) if kind & VALID else None
        result = examine(directory, "name")
        if None not in valid_slots.values():
            newest = max((number for number, _ in valid_slots.values()), default=None)
            expected = [content for number, content in valid_slots.values() if number == newest] or [None]
            assert result.content in expected
        if result.damage:
            check_line(result.damage)
        writer = SlotWriter(directory, frozenset())
        for content in (b"first", b"second", data):
            writer.write("name", content)
            assert examine(directory, "name").content == content
        writer.close()


def encode_slot(number, content):
    """Encode a valid slot by the documented layout."""
    sequence = b"%d" % number
    crc = zlib.crc32(content, zlib.crc32(sequence))
    return b"# rambler state %s %d %08x\n" % (sequence, len(content), crc) + content


MSGPACK_WORDS = (
    b"\xc0",
    b"\xc2",
    b"\xc3",
    b"\xcb" + bytes(8),
    b"\xcb\x7f\xf0" + bytes(6),
    b"\xa4type",
    b"\x80",
    b"\x90",
)
JSON_WORDS = (b'"$":', b'"version":', b"NaN", b"Infinity", b"1e999", b"null", b"true", b"{}", b"[]", b"-0.0", b'":')
QGC_WORDS = (
    b'"fileType":"Plan"', b'"mission":', b'"items":', b'"geoFence":', b'"rallyPoints":', b'"polygons":', b'"circles":',
    b'"polygon":', b'"inclusion":', b'"circle":', b'"center":', b'"radius":', b'"points":', b'"params":', b'"command":',
    b'"frame":', b'"type":"SimpleItem"', b'"plannedHomePosition":', b'"complexItemType":',
    b'"TransectStyleComplexItem":', b'"Items":', b'"version":2', b'"doJumpId":', b'"breachReturn":', b"QGC WPL 110",
)  # fmt: skip
TOML_WORDS = (
    b"[vehicle]", b"[compass]", b"[compass_b]", b"[position]", b"[rudder]", b"[link]", b"[hull]", b"[parameters]",
    b"driver = ", b"port = ", b"baud = ", b"urls = ", b"file = ", b"'''", b'"""', b"inf", b"nan", b"0x", b"[[",
    b"\\u0000", b"length_m = ",
)  # fmt: skip
NAMES = tuple(row.name.encode() for row in TABLE)
URL_WORDS = tuple(
    word.encode()
    for word in (
        "udpin:", "udpout:", "tcpin:", "tcp:", "serial:", "?policy=", "&systems=", "&trusted=1", "class=satellite",
        "signed-only",
    )
)  # fmt: skip
TARGETS = {
    "plan_file": Target(plan_file, (PlanFileError,), (*QGC_WORDS, *JSON_WORDS)),
    "stored_plans": Target(stored_plans, (), JSON_WORDS),
    "parameter_file": Target(parameter_file, (ParameterError,), NAMES, lines=MAX_PROBLEMS + 1),
    "stored_parameters": Target(stored_parameters, (), NAMES),
    "vehicle_file": Target(vehicle_file, (VehicleError, LinkError), (*TOML_WORDS, *NAMES), lines=MAX_PROBLEMS + 1),
    "link_url": Target(link_url, (LinkError,), URL_WORDS, 256),
    "resume_file": Target(resume_file, (), MSGPACK_WORDS),
    "checkpoint": Target(checkpoint, (ValueError,), JSON_WORDS, 16_384),
    "signing_key": Target(signing_key, (), (b"key ", b"timestamp ", b"stream ")),
    "state_import": Target(
        state_import,
        (),
        (b"#", b'{"about":{},"files":{', *(b'"%s":"' % name.encode() for name in STATE_NAMES), *JSON_WORDS),
    ),
    "slots": Target(slots, (), (b"# rambler state ", b"# rambler empty\n")),
}
