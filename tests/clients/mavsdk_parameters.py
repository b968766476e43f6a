"""A client written with MAVSDK that reads and sets parameters of a boat that does not say that it is ArduPilot.

python mavsdk_parameters.py URL RESULTS.json
"""

import json
import sys
from pathlib import Path

# First: it ends the process with 77 where MAVSDK cannot be had.
from mavsdk_system import autopilot

# isort: split
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.param import Param


def main():
    url, results = sys.argv[1:]
    with autopilot(url) as system:
        param = Param(system)
        everything = param.get_all_params()
        param.set_param_float("LOOP_RATE_HZ", 12.0)
        seen = {
            "ints": len(everything.int_params),
            "floats": {row.name: row.value for row in everything.float_params},
            "read_back": param.get_param_float("LOOP_RATE_HZ"),
        }
        try:
            param.set_param_int("LOOP_RATE_HZ", 13)
            seen["as_int"] = "SUCCESS"
        except MavsdkError as error:
            seen["as_int"] = error.result.name
        seen["after_int"] = param.get_param_float("LOOP_RATE_HZ")
        Path(results).write_text(json.dumps(seen))


if __name__ == "__main__":
    main()
