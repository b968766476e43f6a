"""From a goal to the heading to steer."""
