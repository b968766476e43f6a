"""The computer under the autopilot: clock, ports, disk, console."""
