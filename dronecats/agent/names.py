"""What the agents that ship are called: `dronecats.flight.run.agents` makes them."""

PAPER = "paper"  # as the paper has it; what flies unless another is named
STEADY = "steady"  # the one that bears a slow model: docs/steady.md
# as the run.json of version 0.1.0 names them: by the function that made them
FORMER = {"dronecats.run.pilot.papers_agent": PAPER, "dronecats.run.steady.steady_agent": STEADY}


def agent_name(told: object) -> str:
    """Return the name of an agent that a run.json of any version tells; the paper's where it tells none."""
    return FORMER.get(str(told), str(told)) if told else PAPER
