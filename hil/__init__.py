"""The sea in a box: ship, waves and byte-level devices around the unchanged autopilot."""
