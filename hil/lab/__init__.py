"""Laboratory: identification, fish swarm, tuning, comparison, campaigns and fault drills."""
