"""What the verifier reads: the logs of an episode folder (`dronecats.rundir.reading`)."""

from dronecats.rundir.reading import read as read
