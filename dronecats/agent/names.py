"""What the agents that ship are called: `dronecats.run.agents` makes them."""

PAPER = "paper"  # as the paper has it; what flies unless another is named
STEADY = "steady"  # the one that bears a slow model: docs/steady.md
MADE_PAPERS = "dronecats.run.pilot.papers_agent"  # what makes the paper's, as run.json says it
