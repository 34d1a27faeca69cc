"""Names of the built-in agents, which `dronecats.flight.run.pilot` creates. Reports need only the names."""

PAPER = "paper"  # the paper's agent, the default
STEADY = "steady"  # keeps flying while a slow model replies: docs/steady.md
# run.json of version 0.1.0 has the name of the function that created the agent
FORMER = {"dronecats.run.pilot.papers_agent": PAPER, "dronecats.run.steady.steady_agent": STEADY}


def agent_name(name: object) -> str:
    """Return the name of an agent in a run.json of any version; PAPER if it has none."""
    return FORMER.get(str(name), str(name)) if name else PAPER
