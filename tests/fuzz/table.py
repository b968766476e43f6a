"""All that is fuzzed, by name."""

from fuzz import devices, files, link, logs, satellite, view

TARGETS = devices.TARGETS | link.TARGETS | files.TARGETS | logs.TARGETS | satellite.TARGETS | view.TARGETS
