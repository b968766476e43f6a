"""The tools of the naval engineer: identification, the fish swarm, tuning, comparison."""
