"""The satellite link with any output of the modem and any messages.

Each record is output of the modem or a received message. Its kind also selects the time step.
"""

from fuzz.devices import buffered_bytes
from fuzz.target import Target, records
from support.satellite import KEY, SatelliteBoat

MESSAGE, LONG_STEP = 0x01, 0x02
MAX_BUFFERED_BYTES = 16_384


def play(data):
    """Check that input without the key has no effect and that the buffers are bounded."""
    boat = SatelliteBoat(key=KEY)
    boat.modem.take_output = lambda _now_s: b""
    driver = boat.transport._driver
    driver.modem.imei = boat.modem.imei
    for kind, body in records(data):
        if kind & MESSAGE:
            driver.received.append((len(body), body))
        else:
            boat.line.waiting += body
        step_s = 20.0 if kind & LONG_STEP else 0.5
        boat.run_to(boat.now_s + 3.0 * step_s, step_s, step_s)
        boat.delivered()
    assert boat.intents == []
    assert driver.ledger.day_used <= 50 + 6 * driver.counts.sessions
    assert buffered_bytes(driver, {id(boat.network)}) <= MAX_BUFFERED_BYTES


TARGETS = {
    "satellite": Target(
        play,
        words=(
            *(b"\r\nOK\r\n", b"\r\nERROR\r\n", b"\r\nREADY\r\n", b"\r\n0\r\n\r\nOK\r\n", b"\r\nSBDRING\r\n"),
            *(b"+CSQ:5\r\n", b"300234010753370\r\n", b"+SBDSX: 0, 1, 1, 7, 1, 2\r\n", b"+SBDIX: 0, 1, 1, 7, 5, 1\r\n"),
            *(b"\x00\x02hi\x00\xd1", b"\xb5", b"\xfe\x06", b"\xfd\x21"),
        ),
        max_bytes=2048,
    )
}
