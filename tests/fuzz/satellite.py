"""Fuzz the satellite link: arbitrary output of the modem, arbitrary messages.

Each record is output of the modem or a received message. The kind of the record also selects the time step.
"""

from fuzz.devices import buffered_bytes
from fuzz.target import Target, records
from support.satellite import KEY, SatelliteBoat

MESSAGE_FLAG, LONG_STEP_FLAG = 0x01, 0x02  # bits of the kind of a record
MAX_BUFFERED_BYTES = 16_384
DAY_CREDITS = 50  # default of SBD_DAY_CRED
MAX_RECEIVED_CREDITS = 6  # of a message of 270 bytes, the longest that the network delivers


def play(data):
    """Check that input without the key has no effect, and that credits and buffers are bounded."""
    boat = SatelliteBoat(key=KEY)
    boat.modem.take_output = lambda _now_s: b""
    driver = boat.transport._driver
    driver.modem.imei = boat.modem.imei
    for kind, body in records(data):
        if kind & MESSAGE_FLAG:
            driver.received.append((len(body), body))
        else:
            boat.line.waiting += body
        step_s = 20.0 if kind & LONG_STEP_FLAG else 0.5
        boat.run_to(boat.now_s + 3.0 * step_s, step_s, step_s)
        boat.delivered()  # decodes the frames that have arrived on shore
    assert boat.intents == []
    assert driver.ledger.day_used <= DAY_CREDITS + MAX_RECEIVED_CREDITS * driver.counts.sessions
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
