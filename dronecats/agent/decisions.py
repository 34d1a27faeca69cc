"""decisions.jsonl: one line per step and drone, written by the agent, flushed as it happens."""

from dronecats.rundir.rows import Decision as Decision
from dronecats.rundir.writing import LineLog as DecisionLog

__all__ = ["Decision", "DecisionLog"]
