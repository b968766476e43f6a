"""What the disk is read and written by: regular files within a limit, and the modes of what is made."""
