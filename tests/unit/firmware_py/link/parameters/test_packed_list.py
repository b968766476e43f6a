"""The packed parameter list: read by the decoder of MAVProxy, and uploaded in the format of MAVProxy."""

import struct

import pytest

from firmware_py.common.intents import Answer, SetParameter, Verdict
from firmware_py.common.parameter_row import Kind, ParameterError
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.link.files.payload import Opcode
from firmware_py.link.parameters.files import ARDUPILOT, pack, unpack

param_ftp = pytest.importorskip("MAVProxy.modules.lib.param_ftp")
INT32, FLOAT = 3, 4  # type numbers of ArduPilot
MAV_AUTOPILOT_GENERIC = 0
CHANGED = ParameterSet().replaced("CTL_K1", 33.25).replaced("LOOP_RATE_HZ", 20)


def decode(content):
    return {name.decode(): (value, kind) for name, value, kind in param_ftp.ftp_param_decode(content).params}


@pytest.mark.parametrize("query", [{}, {"withdefaults": "1"}])
def test_mavproxy_decodes_all_parameters(query):
    parameters = decode(pack(CHANGED, query, ARDUPILOT))
    assert list(parameters) == [row.name for row in TABLE]
    assert [value for value, _ in parameters.values()] == list(CHANGED.values())
    assert [kind for _, kind in parameters.values()] == [INT32 if row.kind is Kind.INTEGER else FLOAT for row in TABLE]


def test_names_are_stored_without_the_prefix_of_the_previous_name():
    size, previous = 6, ""
    for row in TABLE:
        prefix = next(length for length in range(len(row.name), -1, -1) if previous.startswith(row.name[:length]))
        size, previous = size + 2 + len(row.name) - prefix + 4, row.name
    assert len(pack(CHANGED, {}, ARDUPILOT)) == size


def test_mavproxy_decodes_the_defaults():
    defaults = param_ftp.ftp_param_decode(pack(CHANGED, {"withdefaults": "1"}, ARDUPILOT)).defaults
    assert [value for _, value, _ in defaults] == [row.default for row in TABLE]
    assert param_ftp.ftp_param_decode(pack(CHANGED, {}, ARDUPILOT)).defaults is None


@pytest.mark.parametrize(
    ("query", "rows"),
    [
        ({"start": "3", "count": "4"}, (3, 7)),
        ({"start": "30"}, (30, len(TABLE))),
        ({"count": "2"}, (0, 2)),
        ({"start": "99999"}, (0, 0)),
        ({"start": "100000"}, (0, len(TABLE))),
        ({"count": "0"}, (0, 0)),
        ({"start": "-1", "count": "x", "more": "1"}, (0, len(TABLE))),
        ({"start": "³"}, (0, len(TABLE))),
    ],
)
def test_start_and_count_select_rows(query, rows):
    content = pack(CHANGED, query, ARDUPILOT)
    magic, count, total = struct.unpack_from("<HHH", content)
    assert (magic, count, total) == (0x671B, rows[1] - rows[0], len(TABLE))
    complete = content[:4] + struct.pack("<H", count) + content[6:]  # MAVProxy decodes only complete lists
    assert list(decode(complete)) == [row.name for row in TABLE[rows[0] : rows[1]]]


def encode(values, kinds=None, header=None):
    """Encode values as `param ftpload` of MAVProxy does."""
    body, previous = b"", ""
    for name, value in values.items():
        prefix = next((i for i, (a, b) in enumerate(zip(previous, name, strict=False)) if a != b), 0)
        kind, format_code = kinds or ((4, "f") if value != int(value) else (1, "b") if abs(value) < 128 else (3, "i"))
        body += bytes((kind, prefix | (len(name) - prefix - 1) << 4)) + name[prefix:].encode()
        body += struct.pack(f"<{format_code}", value if format_code == "f" else int(value))
        previous = name
    return struct.pack("<HHH", *(header or (0x671B, len(values), 6 + len(body)))) + body


@pytest.mark.parametrize("kinds", [None, (1, "b"), (2, "h"), (3, "i"), (4, "f")])
def test_upload_of_mavproxy_is_decoded(kinds):
    values = {"CTL_K1": 41.0 if kinds else 41.5, "CTL_K2": 1.0, "LOG_KEEP_MB": 100.0 if kinds else 5000.0}
    content = encode(values, kinds)
    assert unpack(content) == values
    padded = struct.pack("<HHH", 0x671B, 3, len(content) + 5) + b"\0\0" + content[6:] + b"\0\0\0"
    assert unpack(padded) == values
    assert unpack(encode({})) == {}


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "shorter"),
        (encode({"CTL_K1": 41.5}, header=(0x671C, 1, 18)), "begins with"),
        (encode({"CTL_K1": 41.5})[:-1], "bytes received"),
        (encode({"CTL_K1": 41.5}, header=(0x671B, 2, 18)), "instead of 2"),
        (encode({"CTL_K1": 41.5, "NOPE": 1.0}), "unknown parameter 'NOPE'"),
        (encode({"CTL_K1": 1000.5}), "out of range"),
        (encode({"CTL_K1": float("nan")}, kinds=(4, "f")), "not a number"),
        (encode({"LOOP_RATE_HZ": 10.5}), "not a whole number"),
        (encode({"STAT_BOOTCNT": 5.0}), "read-only"),
        (struct.pack("<HHH", 0x671B, 1, 8) + b"\x09\x00", "no valid parameter"),
        (struct.pack("<HHH", 0x671B, 1, 7) + b"\x04", "no valid parameter"),
        (struct.pack("<HHH", 0x671B, 1, 9) + b"\x04\xf0A", "cut off"),
        (struct.pack("<HHH", 0x671B, 1, 13) + b"\x04\x05A\0\0\0\0", "cut off"),
    ],
)
def test_invalid_upload_is_refused(content, reason):
    with pytest.raises(ParameterError, match=reason):
        unpack(content)


def test_upload_sets_and_reports_all_values(rig, ftp_station, of):
    client = ftp_station(rig)
    client.ask(Opcode.CREATE, "@PARAM/param.pck")
    client.ask(Opcode.WRITE, encode({"CTL_K1": 41.5, "CTL_K2": 1.0, "BOOT_MODE": 4.0}))
    replies = rig.send(client.request(Opcode.TERMINATE))
    assert [reply.payload[3] for reply in of(replies, "FILE_TRANSFER_PROTOCOL")] == [Opcode.ACK]
    values = {value.param_id: value.param_value for value in of(replies, "PARAM_VALUE")}
    assert values == {"CTL_K1": 41.5, "CTL_K2": 1.0}
    assert (rig.request_handler.values["CTL_K1"], rig.request_handler.values["CTL_K2"]) == (41.5, 1.0)


@pytest.mark.parametrize(("reason", "text"), [("armed in AUTO", "armed in AUTO"), ("", "refused")])
def test_upload_that_the_boat_refuses_is_reported_with_its_reason(rig, ftp_station, of, texts, reason, text):
    client = ftp_station(rig)
    client.ask(Opcode.CREATE, "@PARAM/param.pck")
    client.ask(Opcode.WRITE, encode({"CTL_K1": 41.5}))
    rig.request_handler.answer = Answer(Verdict.DENIED, reason)
    replies = rig.send(client.request(Opcode.TERMINATE))
    assert texts(replies) == [f"@PARAM/param.pck: {text}"]
    assert of(replies, "PARAM_VALUE") == []


@pytest.mark.parametrize(
    ("is_stored", "text"),
    [
        (True, "LOG_KEEP_MB, LNK_SYSID: takes effect at the next start"),
        (False, "CTL_K1, CTL_K2, LOG_KEEP_MB active but not stored"),
    ],
)
def test_upload_is_reported_after_storing(rig, ftp_station, texts, is_stored, text):
    client = ftp_station(rig)
    rig.request_handler.at_once = False
    client.ask(Opcode.CREATE, "@PARAM/param.pck")
    client.ask(Opcode.WRITE, encode({"CTL_K1": 41.0, "CTL_K2": 7.0, "LOG_KEEP_MB": 100.0, "LNK_SYSID": 7.0}))
    assert rig.send(client.request(Opcode.TERMINATE)) == []
    rig.request_handler.waiting.pop()(is_stored)
    assert texts(rig.replies())[0] == text


def test_upload_requests_only_changes_and_the_fence(rig, ftp_station):
    """A command may have overridden the fence parameter."""
    values = rig.request_handler.values
    ftp_station(rig).put("@PARAM/param.pck", encode({name: values[name] for name in ("CTL_K1", "FENCE_ENABLE")}))
    assert rig.request_handler.intents == [SetParameter("FENCE_ENABLE", values["FENCE_ENABLE"])]


def test_upload_with_one_invalid_value_sets_nothing(rig, ftp_station, texts):
    client = ftp_station(rig)
    client.ask(Opcode.CREATE, "@PARAM/param.pck")
    client.ask(Opcode.WRITE, encode({"CTL_K1": 41.5, "CTL_K2": 1000.0}))
    replies = rig.send(client.request(Opcode.TERMINATE))
    assert "CTL_K2" in texts(replies)[0]
    assert rig.request_handler.values == ParameterSet()
    assert rig.request_handler.requests == []


def test_list_is_read_by_file_transfer(rig, ftp_station):
    rig.request_handler.values = CHANGED
    assert decode(ftp_station(rig).get("@PARAM/param.pck?withdefaults=1"))["CTL_K1"] == (33.25, FLOAT)


def test_generic_autopilot_has_only_floats():
    parameters = decode(pack(CHANGED, {}, MAV_AUTOPILOT_GENERIC))
    assert {kind for _, kind in parameters.values()} == {FLOAT}
    assert {name: value for name, (value, _) in parameters.items()} == pytest.approx(dict(CHANGED.items()))
