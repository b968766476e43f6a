"""All that is fuzzed, by name."""

from fuzz import devices, files, link, logs

TARGETS = devices.TARGETS | link.TARGETS | files.TARGETS | logs.TARGETS
