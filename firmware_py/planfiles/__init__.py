"""Plan files of ground stations: QGroundControl's .plan and .waypoints, MAVProxy's fences and rally points."""
