"""A client of MAVLink FTP that follows the MAVLink guide."""

import struct

from pymavlink.dialects.v20 import common as mavlink

from firmware_py.link.files.payload import Error, Opcode
from support.link import of_type


class Reply:
    """Reply to a file transfer request; `query`: opcode of the request, `last`: whether a burst is complete."""

    def __init__(self, message):
        self.to = (message.target_system, message.target_component)
        assert message.target_network == 0
        payload = bytes(message.payload)
        fields = struct.unpack("<HBBBBBBI", payload[:12])
        self.sequence, self.session, self.opcode, self.size, self.query, self.last, padding, self.offset = fields
        assert (padding, self.last) in ((0, 0), (0, int(self.query == Opcode.BURST_READ)))
        self.data = payload[12 : 12 + self.size]

    @property
    def ok(self):
        return self.opcode == Opcode.ACK

    @property
    def error(self):
        assert self.opcode == Opcode.NAK
        return tuple(self.data)


class FtpStation:
    """A client of MAVLink FTP on a rig."""

    def __init__(self, rig, address="station", session=0):
        self.rig = rig
        self.address = address
        self.session = session
        self.sequence = 0

    def request(self, opcode, data=b"", *, offset=0, size=None, session=None, sequence=None):
        """Return a request message; without `sequence` it has the next sequence number."""
        data = data.encode() if isinstance(data, str) else data
        if sequence is None:
            sequence, self.sequence = self.sequence, (self.sequence + 1) & 0xFFFF
        number = self.session if session is None else session
        size = len(data) if size is None else size
        payload = struct.pack("<HBBBBBBI239s", sequence, number, opcode, size, 0, 0, 0, offset, data)
        return mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload)

    def all(self, *request, **fields):
        """Send a request; return all replies."""
        return self.replies(self.rig.send(self.request(*request, **fields), address=self.address))

    @staticmethod
    def replies(replies):
        """Return the file transfer replies among messages."""
        return [Reply(message) for message in of_type(replies, "FILE_TRANSFER_PROTOCOL")]

    def ask(self, *request, **fields):
        """Send a request; return its only reply."""
        (reply,) = self.all(*request, **fields)
        return reply

    def get(self, path):
        """Read a file with successive read requests; return its content."""
        opened = self.ask(Opcode.OPEN_READ, path)
        assert opened.ok, opened.error
        content = b""
        while (reply := self.ask(Opcode.READ, offset=len(content), size=239)).ok:
            assert reply.data
            content += reply.data
        assert reply.error == (Error.END_OF_FILE,)
        assert self.ask(Opcode.TERMINATE).ok
        assert len(content) == int.from_bytes(opened.data, "little")
        return content

    def put(self, path, content):
        """Write a file; return the reply to the last request."""
        created = self.ask(Opcode.CREATE, path)
        if not created.ok:
            return created
        for start in range(0, len(content), 239):
            assert self.ask(Opcode.WRITE, content[start : start + 239], offset=start).ok
        return self.ask(Opcode.TERMINATE)

    def list(self, path, opcode=Opcode.LIST):
        """Return the lines of a directory listing."""
        lines = []
        while (reply := self.ask(opcode, path, offset=len(lines))).ok:
            assert reply.data
            lines += reply.data.decode().rstrip("\0").split("\0")
        assert reply.error == (Error.END_OF_FILE,), reply.error
        return lines
