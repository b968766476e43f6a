"""File transfer replies to any request, and never reads or changes a file outside its directories."""

import struct
import tempfile
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.link.endpoint import Endpoint
from firmware_py.link.files.payload import Opcode
from firmware_py.link.files.tree import FileRoot
from firmware_py.link.telemetry.identity import Version
from support.link import FakeRequestHandler, MemoryTransport

NAMES = st.sampled_from(
    ["..", ".", "", "logs", "uploads", "secret", "a", "b", "link", "@PARAM", "param.pck?start=1&count=9999999", "\x00"]
)
PATHS = st.lists(NAMES, max_size=5).map(lambda names: "/".join(names).encode())
DATA = st.one_of(PATHS, st.binary(max_size=239), st.tuples(PATHS, PATHS).map(b"\0".join))
REQUEST = st.tuples(
    st.integers(0, 0xFFFF), st.integers(0, 3), st.integers(0, 20) | st.integers(0, 255), DATA,
    st.none() | st.integers(0, 255), st.sampled_from([0, 1, 239, 1 << 20, 0x7FFFFFFF, 0xFFFFFFFF]),
)  # fmt: skip


def files_outside_uploads(root):
    return {
        path.relative_to(root): path.read_bytes() if path.is_file() else None
        for path in root.rglob("*")
        if "uploads" not in path.relative_to(root).parts
    }


@given(st.lists(REQUEST, min_size=1, max_size=25))
def test_any_request_gets_a_reply_and_stays_inside_the_directories(requests):
    """A burst read may have several replies; a message that is itself a reply has none."""
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        for directory in ("logs", "uploads"):
            (root / directory).mkdir()
        (root / "logs" / "a").write_bytes(b"log" * 1000)
        (root / "secret").write_bytes(b"secret")
        (root / "uploads" / "link").symlink_to(root)
        previous = files_outside_uploads(root)
        transport = MemoryTransport()
        storage = FileRoot(dict, root / "logs", root / "uploads")
        endpoint = Endpoint([transport], FakeRequestHandler(), utc_s=lambda: 0.0, version=Version(), storage=storage)
        station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        endpoint.service(0.0, [])
        for sequence, session, opcode, data, size, offset in requests:
            transport.sent.clear()
            fields = (sequence, session, opcode, len(data[:239]) if size is None else size, 0, 0, 0, offset, data)
            payload = struct.pack("<HBBBBBBI239s", *fields)
            request = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload)
            transport.inbox.append(("station", request.pack(station)))
            endpoint.service(0.0, [transport.descriptor])
            while endpoint.busy:
                endpoint.service(0.0, [])
            messages = mavlink.MAVLink(None).parse_buffer(b"".join(data for _, data in transport.sent)) or []
            replies = [bytes(message.payload) for message in messages if message.get_type() == "FILE_TRANSFER_PROTOCOL"]
            assert len(replies) == (opcode not in (Opcode.ACK, Opcode.NAK)) or opcode == Opcode.BURST_READ
            for index, reply in enumerate(replies):
                assert int.from_bytes(reply[:2], "little") == (sequence + 1 + index) & 0xFFFF
                assert (reply[2], reply[5]) == (session, opcode)
                assert b"secret" not in reply[12 : 12 + reply[4]] or opcode in (Opcode.LIST, Opcode.LIST_WITH_TIME)
            assert files_outside_uploads(root) == previous
        endpoint.close()
