"""What tests share: one boat, one rig, one line in memory, and the programs around a running autopilot."""
