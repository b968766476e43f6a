"""The link by satellite: a modem that says anything, and messages from anybody.

Each record is bytes of the modem, or a message that it hands over; time goes on by the kind of the record.
"""

from fuzz.devices import held_bytes
from fuzz.target import Target, records
from support.satellite import KEY, SatelliteBoat

MESSAGE, LATER = 0x01, 0x02
MOST_HELD = 16_384


def play(data):
    """Input without the key changes nothing, and no buffer grows."""
    boat = SatelliteBoat(key=KEY)
    boat.modem.take_output = lambda _now_s: b""
    driver = boat.transport._driver
    driver.modem.imei = boat.modem.imei
    for kind, body in records(data):
        if kind & MESSAGE:
            driver.received.append((len(body), body))
        else:
            boat.line.waiting += body
        step_s = 20.0 if kind & LATER else 0.5
        boat.run_to(boat.now_s + 3.0 * step_s, step_s, step_s)
        boat.delivered()
    assert boat.intents == []
    assert driver.ledger.day_used <= 50 + 6 * driver.counts.sessions
    assert held_bytes(driver, {id(boat.network)}) <= MOST_HELD


TARGETS = {
    "satellite": Target(
        play,
        words=(
            *(b"\r\nOK\r\n", b"\r\nERROR\r\n", b"\r\nREADY\r\n", b"\r\n0\r\n\r\nOK\r\n", b"\r\nSBDRING\r\n"),
            *(b"+CSQ:5\r\n", b"300234010753370\r\n", b"+SBDSX: 0, 1, 1, 7, 1, 2\r\n", b"+SBDIX: 0, 1, 1, 7, 5, 1\r\n"),
            *(b"\x00\x02hi\x00\xd1", b"\xb5", b"\xfe\x06", b"\xfd\x21"),
        ),
        largest=2048,
    )
}
