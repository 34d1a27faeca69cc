"""What becomes of each command of the pages: run, and how it is made short; or not run here, and why not.

A new command in a page that fits no row, or rows of both tables, fails `test_every_command_is_run_or_said_why_not`.
Rows are regular expressions at a command's beginning; the first that fits counts.
"""

import re
from dataclasses import dataclass

# What stands for something else in a page, and what it becomes, in this order; `flown` is a run folder that the test
# has made. Optional parts, in square brackets, are all taken.
PLACEHOLDERS = (
    (r"\[MAP\|ID\|FILE\]|\[ID\|FILE …\]", "residential-approaching-01"),
    (r"\[ASSET …\]", "suv"),
    (r"\[(,ALT|-[^\[\]]*)\]", r"\1"),  # twice, since --target=LAT,LON[,ALT] is optional itself
    (r"\[(,ALT|-[^\[\]]*)\]", r"\1"),
    (r"LAT,LON,ALT", "47.3977,8.5456,488.0"),
    (r"NORTH,EAST", "0,0"),
    (r"--(camera|instruction) …", r"--\1 X"),
    (r"(?<=recorded:)(RUN/EPISODE/decisions\.jsonl|\$FILE)", "flown/residential-approaching-01/decisions.jsonl"),
    (r"\bRUN(_A|_B)?\b|\bruns/…", "flown"),
    (r"(?<=episodes check )FILE\b", "flown/residential-approaching-01/episode.json"),
    (r"(?<=--optics )FILE\.toml", "optics.toml"),
    (r"(?<=--plot )FILE\b", "plot.png"),
    (r"(?<=--map )NAME\b|(?<=maps show )NAME\b|(?<=maps export )NAME\b", "blocks"),
    (r"(?<=--name )NAME\b", "my-map"),
    (r"(?<=--map )M\b", "campus"),
    (r"(?<=--cell )C\b", "searching"),
    (r"(?<=--suite )S\b", "quick"),
    (r"(?<=episodes show )ID\b", "residential-approaching-01"),
    (r"(?<=episodes sheet --out )FILE\b", "sheet.jpg"),
    (r"(?<=--seed )[NS]\b|(?<=--port )N\b|(?<=--log )N\b|(?<=--seconds )N\b", "1"),
    (r"(?<=--cost-limit )USD\b|(?<=--token-limit )N\b", "1"),
    (r"(?<=--target-std )M\b", "3"),
    (r"\bDIR\b", "out"),
    (r" \[--ulog FILE\]| --ulog FILE\b", " --ulog flight.ulg"),
    (r"\bURL\b", "udpin://127.0.0.1:14540"),
    (r" …(?= |$)", ""),  # and so on: what the page has said before
)  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A row of what is run."""

    begins: str
    add: str = ""  # to the command's end, to make it short
    drop: str = ""  # a regular expression of what is left out
    slow: bool = False  # half a minute and more


RUNS = (
    Run(r"dronecats episodes sheet --out docs/", slow=True),
    Run(r"dronecats episodes (list|show|sheet \S|probe|check \S)"),
    Run(r"dronecats episodes check$", add="--rules residential-approaching-01 campus-searching-01"),
    Run(r"dronecats episodes new --map", add="--count 1"),
    Run(r"dronecats episodes audit( --pilot blind:ring)?$", add="residential-approaching-01"),
    Run(r"dronecats episodes audit \[--suite S\]", add="residential-approaching-01", drop=r"--suite \S+"),
    Run(r"dronecats flightlog trace runs/c", slow=True),  # which is flown by the line above it
    Run(r"dronecats (maps (?!import$)|tune|judge|flightlog trace|doctor)", drop=r"--ulog \S+"),
    Run(r"dronecats compare RUN", add="--seconds 5"),  # the flight of the test lasts no minute
    Run(r"dronecats fly --sitl --speed max --pilot recorded", slow=True),
    Run(r"dronecats fly --sitl --speed max --(latency|pilot blind)", slow=True),
    Run(r"dronecats fly --sitl --model replay:RUN", add="--out replayed", slow=True),
    Run(r"dronecats fly --spec RUN", add="--episode residential-approaching-01 --out again", slow=True),
    Run(r"python -m benchmarks\.\S+", add="--short"),
    Run(r"dronecats episodes optics", slow=True),
)

VEHICLE = "a vehicle or a camera that is running; tests/system, tests/hil/cameras, tests/cli do it"
PX4 = "a real PX4; tests/system runs it where DRONECATS_PX4 names one"
FOREVER = "runs until it is interrupted, on ports that somebody else may have; tests/system/test_clients.py does it"
REAL_TIME = "minutes in real time; tests/system/test_realtime.py flies it"

ELSEWHERE = (
    (r"dronecats$|dronecats fly$", "the program or a verb, named"),
    (r"dronecats fly --sitl .*--model (?!replay:)", "a model's endpoint and key; tests/agent has endpoints of its own"),
    (r"dronecats fly --sitl --autopilot px4", PX4),
    (r"dronecats fly --sitl( --episode \S+ --pilot vision| --optics FILE\.toml)?$", REAL_TIME),
    (r"(echo ARM \| )?dronecats fly (--connect|…)", VEHICLE),
    (r"dronecats (preflight|camera|flightlog (list|fetch))\b", VEHICLE),
    (r"dronecats compare runs/ours runs/px4", PX4),
    (r"dronecats sitl --hitl", "a board"),
    (r"dronecats sitl\b|dronecats impair\b", FOREVER),
    (r"dronecats edit\b", "a browser's page, until it is interrupted; tests/editor does it"),
    (r"dronecats episodes audit --write-par", "the hundred, and rewrites a file that ships"),
    (r"dronecats episodes audit --pilot vision", "the hundred, every frame drawn: an hour"),
    (r"dronecats episodes audit --pilot blind:NAME( --write-blind)?$", "the hundred to their caps, and keeps them"),
    (r"dronecats episodes new --official", "the hundred, minutes; tests/episodes makes some of them again"),
    (r"dronecats maps import$|dronecats episodes sheet$", "a verb, named; the page or another one has it in full"),
    (r"make px4_sitl", "in PX4's sources"),
    (r"make ", "an environment of its own, from the network; that the target is there is tested"),
    (r"pytest ", "a test, which is run as one; that it is there is tested"),
)  # fmt: skip


def row(text: str) -> Run | str:
    """Return how a command is run, or the reason why it is not. Raises LookupError when no row or two say so."""
    run = next((run for run in RUNS if re.match(run.begins, text)), None)
    reason = next((reason for begins, reason in ELSEWHERE if re.match(begins, text)), None)
    if (run is None) == (reason is None):
        raise LookupError("both tables" if run else "neither table")
    return run or str(reason)


def filled(text: str) -> str:
    """Return a command with something real for every placeholder."""
    for pattern, value in PLACEHOLDERS:
        text = re.sub(pattern, value, text)
    return text
