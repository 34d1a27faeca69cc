"""The run folder: the names of its files, the rows of its logs, their writer and their strict reader."""
