"""MAVExplorer's own graphs, and which of them a log has the numbers for."""

import importlib.util
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from pymavlink import mavutil


def drawn(messages):
    """How many of MAVExplorer's expressions are numbers throughout, and how many there are."""
    package = importlib.util.find_spec("MAVProxy")
    if package is None:
        pytest.skip("MAVProxy is not installed; install the extra [clients]")
    paths = sorted(Path(package.origin).parent.glob("tools/graphs/*.xml"))
    expressions = [text for path in paths for one in ET.parse(path).iter("expression") if (text := one.text)]

    def finite(field):
        try:
            value = mavutil.evaluate_expression(field.removesuffix(":1").removesuffix(":2"), messages)
        except (AttributeError, TypeError):  # as MAVExplorer, which leaves such a graph out
            return False
        return isinstance(value, int | float) and math.isfinite(value)

    return sum(all(map(finite, text.split())) for text in expressions), len(expressions)
