"""MAVLink commands: functions and rows by subject, and the server that executes and acknowledges them."""
