"""Serial lines in memory."""


class FakeLine:
    """A ByteLine with the test or a device at the other end.

    A device has `handle(data)`, which returns its reply at once. `noise` is received before each reply, the next
    `lose_replies` replies are lost, with `echo` all written bytes are received, and a `full` line accepts no bytes.
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
    """A line with an adapter that delays each reply by `delay_s()`, or loses it (None), without a change of order.

    The test sets `now_s`. `request_times_s` are the times of the requests with a reply.
    """

    def __init__(self, device, delay_s, baud=57600):
        super().__init__(device, baud=baud)
        self.delay_s = delay_s
        self.now_s = 0.0
        self.request_times_s = []
        self._delayed = []  # time of arrival, bytes

    def read(self):
        while self._delayed and self._delayed[0][0] <= self.now_s:
            self.inbox += self._delayed.pop(0)[1]
        return super().read()

    def write(self, data):
        size = len(self.inbox)
        is_written = super().write(data)
        reply = bytes(self.inbox[size:])
        del self.inbox[size:]
        if reply:
            self.request_times_s.append(self.now_s)
            delay_s = self.delay_s()
            if delay_s is not None:
                earliest_s = self._delayed[-1][0] if self._delayed else 0.0
                self._delayed.append((max(earliest_s, self.now_s + delay_s), reply))
        return is_written
