"""`rambler-hil bench`: what the autopilot costs and how fast it is, beside what the machine itself can do."""
