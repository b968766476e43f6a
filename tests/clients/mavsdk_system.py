"""What the clients written with MAVSDK share: the library if it can be had, the autopilot at the end of a link, waits.

MAVSDK's library writes to standard output from threads of its own, so the clients are processes of their own that
write their results to files. Exit code 77 says that MAVSDK cannot be had on this machine.
"""

import contextlib
import sys
import time

try:
    from mavsdk.component_type import ComponentType
    from mavsdk.mavsdk import Configuration, Mavsdk
except Exception as missing:  # noqa: BLE001 - whatever keeps the wheel and its library from loading here
    print(f"MAVSDK cannot be had: {missing!r}")
    sys.exit(77)

DISCOVERY_S = 40.0
METRES_PER_DEGREE = 111_195.0


@contextlib.contextmanager
def autopilot(url):
    """The first autopilot that is heard on a link."""
    with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk_:
        print(mavsdk_.add_any_connection(url).name)
        system = mavsdk_.first_autopilot(DISCOVERY_S)
        if system is None:
            sys.exit(f"no autopilot on {url} within {DISCOVERY_S:g} s")
        yield system


def wait(look, what, patience_s=80.0):
    """Wait until look() is true, or end with the reason."""
    give_up_s = time.monotonic() + patience_s
    while not look():
        if time.monotonic() > give_up_s:
            sys.exit(f"waited in vain for {what}")
        time.sleep(0.05)
