"""`dronecats sitl` over an open field: the same command, with nothing but the ground of its map.

The examples fly courses laid over the empty world that PX4's own simulation starts in; at the same coordinates a street
stands here, and some would fly through its houses.
"""

import sys

from dronecats.cli.main import main
from dronecats.flight.sitl import simulation as scenario
from foundation.terrain import OPEN

vars(scenario)["obstacles"] = lambda scene: OPEN
sys.exit(main(["sitl", *sys.argv[1:]]))
