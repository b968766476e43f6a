"""A serial line in memory."""


class FakeLine:
    """A ByteLine whose far end is the test, or a device that answers at once.

    A device has `handle(data)`, which returns its answer. `noise` comes before every answer,
    the next `lose_replies` answers are lost, `echo` sends back what is written, and a `full` line
    takes nothing.
    """

    def __init__(self, device=None, name="/dev/fake", baud=57600):
        self.device = device
        self.name = name
        self.baud = baud
        self.openings = 1
        self.connected = True
        self.full = False
        self.echo = False
        self.noise = b""
        self.lose_replies = 0
        self.inbox = bytearray()
        self.written = []

    def fileno(self):
        return 7 if self.connected else -1

    def read(self):
        if not self.connected:
            return b""
        data = bytes(self.inbox[:4096])
        del self.inbox[:4096]
        return data

    def write(self, data):
        if not self.connected or self.full:
            return False
        self.written.append(bytes(data))
        if self.echo:
            self.inbox += data
        reply = self.device.handle(data) if self.device is not None else b""
        if reply and self.lose_replies > 0:
            self.lose_replies -= 1
            reply = b""
        self.inbox += self.noise + reply
        return True

    def unplug(self):
        self.connected = False
        self.inbox.clear()

    def plug(self):
        self.connected = True
        self.openings += 1
