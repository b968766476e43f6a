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


class LateLine(FakeLine):
    """A line behind an adapter that holds answers back: each comes `delay_s()` after its question, or never (None).

    The order stays. `now_s` is the test's to set, and `asked` says of each question with an answer when it was put.
    """

    def __init__(self, device, delay_s, baud=57600):
        super().__init__(device, baud=baud)
        self.delay_s = delay_s
        self.now_s = 0.0
        self.request_times_s = []
        self._under_way = []  # when there, bytes

    def read(self):
        while self._under_way and self._under_way[0][0] <= self.now_s:
            self.inbox += self._under_way.pop(0)[1]
        return super().read()

    def write(self, data):
        before = len(self.inbox)
        taken = super().write(data)
        answer = bytes(self.inbox[before:])
        del self.inbox[before:]
        if answer:
            self.request_times_s.append(self.now_s)
            delay_s = self.delay_s()
            if delay_s is not None:
                earliest_s = self._under_way[-1][0] if self._under_way else 0.0
                self._under_way.append((max(earliest_s, self.now_s + delay_s), answer))
        return taken
