"""Common part of the clients written with MAVSDK: import of the library, the autopilot on a link, waiting.

The library of MAVSDK writes to standard output from its own threads, so the clients are separate processes that write
their results to files. Exit code 77: MAVSDK is not usable on this machine.
"""

import contextlib
import sys
import time

try:
    from mavsdk.component_type import ComponentType
    from mavsdk.mavsdk import Configuration, Mavsdk
except Exception as error:  # noqa: BLE001 - any problem of the wheel or its library
    print(f"MAVSDK is not usable: {error!r}")
    sys.exit(77)

DISCOVERY_S = 40.0
METRES_PER_DEGREE = 111_195.0


@contextlib.contextmanager
def autopilot(url):
    """Yield the first autopilot that is received on a link."""
    with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as library:
        print(library.add_any_connection(url).name)
        system = library.first_autopilot(DISCOVERY_S)
        if system is None:
            sys.exit(f"no autopilot on {url} within {DISCOVERY_S:g} s")
        yield system


def wait(is_true, what, timeout_s=80.0):
    """Wait until is_true() returns true; exit with a message that names `what` after timeout_s."""
    deadline_s = time.monotonic() + timeout_s
    while not is_true():
        if time.monotonic() > deadline_s:
            sys.exit(f"no {what} within {timeout_s:g} s")
        time.sleep(0.05)
