"""The artificial fish swarm: finds the least value of any objective within a box."""

from hil.lab.swarm.records import CompiledObjective, SwarmHistory, SwarmProgress, SwarmResult
from hil.lab.swarm.search import minimise
from hil.lab.swarm.settings import SettingsError, SwarmSettings

__all__ = [
    "CompiledObjective",
    "SettingsError",
    "SwarmHistory",
    "SwarmProgress",
    "SwarmResult",
    "SwarmSettings",
    "minimise",
]
