"""decisions.jsonl: one line per step and drone, written by the agent, flushed as it happens."""

from foundation.run_folder.rows import Decision as Decision
from foundation.run_folder.writing import LineLog as DecisionLog

__all__ = ["Decision", "DecisionLog"]
