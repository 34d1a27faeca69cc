"""Runs `dronecats sitl` over an open field: the map has only its ground.

The examples are made for the empty world of PX4's own simulation. At the same coordinates, this map has a street, and
some examples would fly through its houses.
"""

import sys

from dronecats.cli.main import main
from dronecats.flight.sitl import simulation as scenario
from foundation.terrain import OPEN

vars(scenario)["obstacles"] = lambda scene: OPEN
sys.exit(main(["sitl", *sys.argv[1:]]))
