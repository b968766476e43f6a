"""What is read from files: plans, parameters, vehicles, and what a state directory holds."""

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
from fuzz.boat import AFTERWARDS, UTC_S, inputs_at
from fuzz.target import Target, bits, check_finite, check_line, records
from support.plans import item, mission

FIRST_TICKS = 4


def as_file(read):
    """Make a reader of a path one of bytes."""

    @functools.wraps(read)
    def run(data):
        with tempfile.TemporaryDirectory() as name:
            path = Path(name) / "file"
            path.write_bytes(data)
            read(path)

    return run


# ------------------------------------------------------------------------------------ plans


def check_plan(plan):
    """A plan that was taken is kept, and written into files, as it is."""
    assert problem_of(plan) is None
    assert plan_from_text(plan_to_text(plan)) == (plan, ())
    json.dumps([item_fields(item) for item in plan.items], allow_nan=False)


def plan_file(data):
    """Read a plan file of any kind; the first byte says whether item 0 is home."""
    plans = {plan.kind: plan for plan in read_plan_file(data[1:], "file", home=not (data[:1] or b"\0")[0] & 1)}
    for plan in plans.values():
        check_plan(plan)
    kept = SimpleNamespace(**{kind.name.lower(): plans.get(kind) for kind in PlanKind}, of=plans.get)
    if set(plans) == set(PlanKind):
        again = {plan.kind: plan for plan in read_plan_file(write_plan(kept).encode(), "again")}
        assert again == plans
    for plan in plans.values():
        assert not plan.items or read_plan_file(write_text(plan).encode(), "again") == (plan,)


def stored_plans(data):
    """Read the plans of a state directory; a bad one is ignored and reported."""
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
        assert bits(TABLE[INDEX[name]].check(value)) == bits(value)


def parameter_file(data):
    """Read a parameter file as `rambler params` does; what it writes is read as the same."""
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        return
    values = parse_file(text, "file")
    check_values(values)
    assert parse_file(format_file(values), "again") == values


def stored_parameters(data):
    """Read the parameters of a state directory; a bad line is ignored and reported."""
    messages = []
    store = SimpleNamespace(load={PARAMETER_FILE: data}.get)
    usable, unusable = load_parameters(store, messages.append)
    for line in messages:
        check_line(line)
    check_values(usable)
    again = SimpleNamespace(load={PARAMETER_FILE: format_file(unusable | usable).encode()}.get)
    assert load_parameters(again, messages.append) == (usable, unusable)


@as_file
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
    """A boat that begins with this state runs, and its rudder command is a number."""
    for index in range(FIRST_TICKS):
        state, output = step(state, inputs_at(index, 0.1 * index))
        check_finite(output.command)
        assert abs(output.command.shaft_rad) <= math.pi
        check_finite(output.snapshot)
        for event in output.events:
            check_line(event.text)
    again, notes = state_from_text(state_to_text(state))
    assert notes == ()
    assert state_to_text(again) == state_to_text(state)


@functools.cache
def waking_state():
    values = ParameterSet().replaced("BOOT_RESUME", 2).replaced("BOOT_RESUME_H", 100)
    return State.at_start(values, mission(item(16, 500.0, 0.0), item(19, 500.0, 500.0, 60.0), item(20)))


def resume_file(data):
    """Wake with a resume record that holds anything."""
    messages = []
    state = resume(waking_state(), data, AFTERWARDS, messages.append)
    for line in messages:
        check_line(line)
    check_line(state.greeting)
    check_ticks(state)


def checkpoint(data):
    """Read the state of a log, of any version, and write it again."""
    state, notes = state_from_text(data.decode("utf-8", "surrogateescape"))
    for note in notes:
        check_line(note)
    text = state_to_text(state)
    again, notes = state_from_text(text)
    assert notes == ()
    assert state_to_text(again) == text


def signing_key(data):
    """Take up a stored key; what cannot be read is a lost one, and a new key can be set in any case."""
    saved = []

    def save(content, *, both_slots=False):
        saved.append(content)

    def restored(content):
        signing = Signing(lambda: UTC_S, save)
        state = signing.restore(Stored(content))
        assert signing.active == (state is KeyState.PRESENT)
        assert bool(signing.problem) == (state is KeyState.LOST)
        return signing

    signing = restored(data)
    assert signing.active or signing.problem or not data
    if signing.active:
        signing.store_exactly()
        again = restored(saved[-1])
        again.store_exactly()
        assert saved[-1] == saved[-2]
        assert signing.set_key(signing._key, 0)
        assert restored(saved[-1]).active  # now ahead of what was used
    assert signing.set_key(b"k" * 32, 0)
    assert signing.problem == ""
    assert restored(saved[-1]).active


def state_import(data):
    """Import what anybody may have made, and start with the same as an import that was cut off.

    The first byte says whether the rest is given the head of an export. What cannot be used is set aside, and the
    state of before counts.
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


SEALED, ABSENT, LONG = 0x01, 0x02, 0x04


def slots(data):
    """Find what two slots hold, then write: what is written last is what is found."""
    with tempfile.TemporaryDirectory() as name:
        directory, whole = Path(name), {}
        for slot, (kind, body) in zip((0, 1), records(data), strict=False):
            if kind & ABSENT:
                continue
            content = sealed(kind >> 4, body) if kind & SEALED else body
            (directory / f"name.{slot}").write_bytes(content + (b"\0" * 4096 if kind & LONG else b""))
            whole[slot] = (kind >> 4, body) if kind & SEALED else None
        found = examine(directory, "name")
        if None not in whole.values():
            newest = max((number for number, _ in whole.values()), default=None)
            expected = [content for number, content in whole.values() if number == newest] or [None]
            assert found.content in expected
        if found.damage:
            check_line(found.damage)
        writer = SlotWriter(directory, frozenset())
        for content in (b"first", b"second", data):
            writer.write("name", content)
            assert examine(directory, "name").content == content
        writer.close()


def sealed(number, content):
    """Return a whole slot, by its documented layout."""
    sequence = b"%d" % number
    check = zlib.crc32(content, zlib.crc32(sequence))
    return b"# rambler state %s %d %08x\n" % (sequence, len(content), check) + content


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
