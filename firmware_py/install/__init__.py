"""What makes a program on a computer a service of it: unit, user, device names, directories, and how they get there."""
