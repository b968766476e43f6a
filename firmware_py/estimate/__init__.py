"""What is known of the boat: heading, yaw rate, drift."""
