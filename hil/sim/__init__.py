"""A run: the world, the board of devices, time, the autopilot as a process."""
