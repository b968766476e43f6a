"""`rambler-hil bench`: what the autopilot costs, and how fast the tools are, on this machine."""
