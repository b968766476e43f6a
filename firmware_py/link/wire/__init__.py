"""Bytes: transports, framing, queues."""
