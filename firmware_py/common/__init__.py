"""What every room may use: records, parameters, plans, angles, the earth; pure."""
