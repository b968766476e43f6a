"""Predefined graphs of MAVExplorer, and the number of them that a log can fill."""

import importlib.util
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from pymavlink import mavutil


def count_graphs(messages):
    """Return the number of MAVExplorer's graphs whose expressions are all numbers, and the number of all graphs."""
    package = importlib.util.find_spec("MAVProxy")
    if package is None:
        pytest.skip("MAVProxy is not installed; install the extra [clients]")
    paths = sorted(Path(package.origin).parent.glob("tools/graphs/*.xml"))
    expressions = [text for path in paths for entry in ET.parse(path).iter("expression") if (text := entry.text)]

    def is_finite(field):
        try:
            value = mavutil.evaluate_expression(field.removesuffix(":1").removesuffix(":2"), messages)
        except (AttributeError, TypeError):  # MAVExplorer leaves out such a graph
            return False
        return isinstance(value, int | float) and math.isfinite(value)

    return sum(all(map(is_finite, text.split())) for text in expressions), len(expressions)
