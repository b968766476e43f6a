"""Artificial fish swarm: minimises any objective within a box."""

from hil.lab.swarm.records import (
    CompiledObjective,
    SettingsError,
    SwarmHistory,
    SwarmProgress,
    SwarmResult,
    SwarmSettings,
)
from hil.lab.swarm.search import minimise

__all__ = [
    "CompiledObjective",
    "SettingsError",
    "SwarmHistory",
    "SwarmProgress",
    "SwarmResult",
    "SwarmSettings",
    "minimise",
]
