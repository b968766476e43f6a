"""State estimation: heading, yaw rate, rudder bias, waves, speed, current and position; pure."""
