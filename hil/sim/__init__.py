"""A run: the world, the board of devices, time, and the autopilot as a process."""
