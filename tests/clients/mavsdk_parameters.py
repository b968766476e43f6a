"""A client written with MAVSDK: it reads and sets parameters of a boat that is not identified as ArduPilot.

python mavsdk_parameters.py URL RESULTS.json
"""

import json
import sys
from pathlib import Path

# First: it ends the process with code 77 if MAVSDK is not usable.
from mavsdk_system import autopilot

# isort: split
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.param import Param


def main():
    url, result_file = sys.argv[1:]
    with autopilot(url) as system:
        param = Param(system)
        parameters = param.get_all_params()
        param.set_param_float("LOOP_RATE_HZ", 12.0)
        results = {
            "ints": len(parameters.int_params),
            "floats": {row.name: row.value for row in parameters.float_params},
            "read_back": param.get_param_float("LOOP_RATE_HZ"),
        }
        try:
            param.set_param_int("LOOP_RATE_HZ", 13)
            results["as_int"] = "SUCCESS"
        except MavsdkError as error:
            results["as_int"] = error.result.name
        results["after_int"] = param.get_param_float("LOOP_RATE_HZ")
        Path(result_file).write_text(json.dumps(results))


if __name__ == "__main__":
    main()
