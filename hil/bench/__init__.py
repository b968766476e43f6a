"""`rambler-hil bench`: cost of the autopilot and speed of the tools on this machine."""
