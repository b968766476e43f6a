"""Transports, frames, and queues of messages to be sent."""
