"""Names of the files and folders in a run folder. Contract: docs/run-folder.md."""

# files of a run
RUN = "run.json"
LEDGER = "ledger.sqlite"  # costs of the models, and the rate limits of their endpoints
UNFINISHED = "unfinished"  # folder of flights without a score
RETRIED = "retried"  # folder of flights that did not move and were flown again
RETRIES = "retries.json"  # outcome and track length of each flight in RETRIED

# files of a benchmark or a study, in the folder of its runs
BENCH = "bench.json"  # the suite and the runs of a benchmark
STUDY = "study.json"  # the varied settings of each run of a study

# files of an episode
EPISODE = "episode.json"  # the episode's record: map, start, target, instruction
WORLD = "world.json"  # the record of the rendered world, only in flights that are not judged
DECISIONS = "decisions.jsonl"  # written by the agent
COMMANDER = "commander.jsonl"  # written by the agent if there is a commander: every exchange with the commander
PROMPTS = "prompts.jsonl"  # written by the agent: the text of every question
TRUTH = "truth.jsonl"  # written by the logger: the true poses
ESTIMATE = "estimate.jsonl"  # the autopilot's position estimate, derived after a flight without truth
VERDICT = "verdict.json"
IDENTITY = "identity.json"  # digests of the code, the record and the frames
TLOG = "flight.tlog"  # raw MAVLink
FRAMES = "frames"  # folder of the pilot's pictures
INTENT = "intent"  # folder of the pictures of a dry run
PICTURE = "flight.png"
SAFETY = "safety.jsonl"  # changes of setpoints by the safety envelope, if any


def frame_name(frame_id: int, drone: int = 0) -> str:
    """Return the name of a frame's picture in FRAMES: NNNNNN.jpg for the first drone, NNNNNN_dK.jpg for others."""
    return f"{frame_id:06d}{_of(drone)}.jpg"


def depth_name(frame_id: int, drone: int = 0) -> str:
    """Return the name of a frame's depth picture in FRAMES: NNNNNN.depth.png, for others NNNNNN_dK.depth.png."""
    return f"{frame_id:06d}{_of(drone)}.depth.png"


def intent_name(step: int, drone: int = 0) -> str:
    """Return the name of a decision's picture in INTENT: NNNN.jpg for the first drone, NNNN_dK.jpg for others."""
    return f"{step:04d}{_of(drone)}.jpg"


def onboard_log_name(drone: int = 0) -> str:
    """Return the name of the log that a drone's autopilot wrote: onboard.ulg, for others onboard_dK.ulg."""
    return f"onboard{_of(drone)}.ulg"


def _of(drone: int) -> str:
    return f"_d{drone}" if drone else ""
