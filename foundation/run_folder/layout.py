"""The names of everything in a run folder. Contract: docs/run-folder.md."""

# of the run
RUN = "run.json"
LEDGER = "ledger.sqlite"  # what its models have cost, and whose turn it is
UNFINISHED = "unfinished"  # folder of what was broken off or was nobody's score, for whoever wants to look at it
RETRIES = "retries.json"  # which episodes did not move, and were flown once more

# of a benchmark, above its runs
BENCH = "bench.json"  # what it consists of
STUDY = "study.json"  # of a study: which of the runs was flown at which levels

# of an episode
EPISODE = "episode.json"  # the record that was flown
WORLD = "world.json"  # the record that was drawn and not judged
DECISIONS = "decisions.jsonl"  # by the agent
COMMANDER = "commander.jsonl"  # by the agent, of a hierarchy: every exchange with its commander
PROMPTS = "prompts.jsonl"  # by the agent: the text of every question
TRUTH = "truth.jsonl"  # by the logger
ESTIMATE = "estimate.jsonl"  # derived after a flight without truth
VERDICT = "verdict.json"
IDENTITY = "identity.json"  # what was really flown
TLOG = "flight.tlog"  # raw MAVLink
FRAMES = "frames"  # folder of what the pilot saw
INTENT = "intent"  # folder of what a dry run meant
PICTURE = "flight.png"
SAFETY = "safety.jsonl"  # what the envelope limited, if it ever did


def frame_name(frame_id: int, drone: int = 0) -> str:
    """Return the name of a frame's picture within FRAMES: NNNNNN.jpg, of other drones than the first NNNNNN_dK.jpg."""
    return f"{frame_id:06d}{_of(drone)}.jpg"


def intent_name(step: int, drone: int = 0) -> str:
    """Return the name of a decision's picture within INTENT: NNNN.jpg, of other drones than the first NNNN_dK.jpg."""
    return f"{step:04d}{_of(drone)}.jpg"


def onboard_log_name(drone: int = 0) -> str:
    """Return the name of the log that a drone's autopilot wrote itself: onboard.ulg, of others onboard_dK.ulg."""
    return f"onboard{_of(drone)}.ulg"


def _of(drone: int) -> str:
    return f"_d{drone}" if drone else ""
