"""The run folder: the names of its files, the rows of its logs, the one writer and the one strict reader."""
