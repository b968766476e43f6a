"""Telemetry: the table of messages, their builders and rates."""
