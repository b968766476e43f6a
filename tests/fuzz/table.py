"""All fuzz targets by name."""

from fuzz import devices, files, link, logs, satellite, steering, view

TARGETS = (
    devices.TARGETS | link.TARGETS | files.TARGETS | logs.TARGETS | satellite.TARGETS | steering.TARGETS | view.TARGETS
)
