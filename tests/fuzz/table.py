"""All that is fuzzed, by name."""

from fuzz import devices, files, link, logs, view

TARGETS = devices.TARGETS | link.TARGETS | files.TARGETS | logs.TARGETS | view.TARGETS
