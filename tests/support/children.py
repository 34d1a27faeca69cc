"""The processes that a program has started, looked up while they come and go."""

import contextlib

import psutil


def children(word: str, parent: int | None = None) -> list[psutil.Process]:
    """Return the living descendants of process parent (None: this one) with word among the words of their command.

    One that ends while it is looked at is left out: its command can no longer be read (psutil tells a process that
    nobody has waited for yet as a ZombieProcess, a kind of NoSuchProcess).
    """
    processes: list[psutil.Process] = []
    for child in psutil.Process(parent).children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            if word in child.cmdline():
                processes.append(child)
    return processes
