"""Descendant processes of a program, which may start and end during the lookup."""

import contextlib

import psutil


def children(word: str, parent: int | None = None) -> list[psutil.Process]:
    """Return the living descendants of process `parent` (None: this one) whose command contains the argument `word`.

    An argument MODULE:NAME counts as MODULE. A process that ends during the lookup is omitted, because its command can
    no longer be read. psutil reports an ended process that its parent has not waited for as a ZombieProcess, a kind of
    NoSuchProcess.
    """
    processes: list[psutil.Process] = []
    for child in psutil.Process(parent).children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            if word in [argument.partition(":")[0] for argument in child.cmdline()]:
                processes.append(child)
    return processes
