"""Names of the built-in agents; `dronecats.flight.run.pilot` makes them. Apart, since reports need only the names."""

PAPER = "paper"  # the paper's, and the default
STEADY = "steady"  # tolerates a slow model: docs/steady.md
# run.json of version 0.1.0 has the name of the function that made them
FORMER = {"dronecats.run.pilot.papers_agent": PAPER, "dronecats.run.steady.steady_agent": STEADY}


def agent_name(name: object) -> str:
    """Return the name of an agent in a run.json of any version; the paper's where it has none."""
    return FORMER.get(str(name), str(name)) if name else PAPER
