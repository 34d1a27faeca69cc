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
    (r"--(camera|instruction|model) …", r"--\1 X"),
    (r"(?<=trace:)rig/trace\.csv", "flown"),
    (r"(?<=recorded:)(RUN/EPISODE/decisions\.jsonl|\$FILE)", "flown/residential-approaching-01/decisions.jsonl"),
    (r"(?<=residential-approaching-03 --out )RUN\b", "filmed"),  # by another pilot than the test's run
    (r"(?<=\bRUN)…", ""),
    (r"\bRUN(_A|_B)?\b|\bruns/…", "flown"),
    (r"(?<=--metric )FILE\.py", "own.py"),
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
    (r"docs/leaderboard/\*\.json|(?<=verify )FILE\b", "entry.tar.xz"),
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
    Run(r"dronecats (maps (?!import$)|tune|judge .|audit|flightlog trace|doctor)", drop=r"--ulog \S+"),
    Run(r"dronecats query "),
    Run(r"dronecats bench export-parquet "),
    Run(r"dronecats film RUN", add="--to 1 --size 320x180 --jobs 1"),
    Run(r"dronecats export RUN", add="--overwrite"),
    Run(r"dronecats report RUN"),
    Run(r"dronecats submit RUN", add="--partial"),  # the flight of the test is no suite
    Run(r"dronecats (verify|leaderboard)\b"),
    Run(r"dronecats compare RUN", add="--seconds 5"),  # the flight of the test lasts no minute
    Run(r"dronecats fly --sitl --speed max --pilot recorded", slow=True),
    Run(r"dronecats fly --sitl --speed max --(latency|frame|pilot (blind|failing|noisy|oracle|vision))", slow=True),
    Run(r"dronecats fly --sitl --model replay:RUN", add="--out replayed", slow=True),
    Run(r"dronecats fly --spec RUN", add="--episode residential-approaching-01 --out again", slow=True),
    Run(r"python -m benchmarks\.(?!vision_errors)\S+", add="--short"),
    Run(r"dronecats episodes optics", slow=True),
    Run(r"dronecats bench --suite quick --pilot oracle --out", add="--limit 1"),
    Run(r"dronecats models (list|show)"),
    Run(r"dronecats study loop --out DIR$", add="--airframe nano --loops attitude --part margins"),
    Run(
        r"dronecats study load --busy 0,2,4,8 --out DIR$",
        add="--busy 0,1 --episodes residential-approaching-01 --seconds 4",
    ),
)

VEHICLE = "a vehicle or a camera that is running; tests/system, tests/hil/cameras, tests/cli do it"
PX4 = "a real PX4; tests/system runs it where DRONECATS_PX4 names one"
FOREVER = "runs until it is interrupted, on ports that somebody else may have; tests/system/test_clients.py does it"
STUDY = "wants a study that was flown; tests/study/report writes several"
RIG = "wants a rig that was measured; tests/study/rate reads these commands as they are printed"
LEARNT = "minutes of drafting and fitting, with PyTorch; tests/examples does each on a small scale"
REAL_TIME = "minutes in real time; tests/system/test_realtime.py flies it"

ELSEWHERE = (
    (r"dronecats$|dronecats fly( --view)?$", "the program or a verb, named"),
    (r"dronecats fly --sitl .*--model (?!replay:)", "a model's endpoint and key; tests/agent does it with its own"),
    (r"dronecats bench .*--model ", "a model's endpoint and key; tests/cli benches with endpoints of its own"),
    (r"dronecats (bench|judge|film|export|study report)$", "a verb, named; its page has it in full"),
    (r"dronecats bench --suite all ", "a hundred flights, or a cluster"),
    (r"dronecats bench --suite one-drone ", "eighty flights and more"),
    (r"dronecats (bench docs/reports/|report (vision oracle|failing) )", "runs of an hour, which are not kept"),
    (r"dronecats study (latency|jitter) ", "minutes of rendered flights; tests/cli/test_study.py flies a small one"),
    (r"dronecats study report (DIR|latency|steady|jitter|link-loss|wind-latency)\b", STUDY),
    (r"dronecats study load --busy 0,4,8 ", "twenty minutes of a quiet machine; the row of the page flies a small one"),
    (r"dronecats study run docs/studies/", "a hundred flights; tests/study/test_page.py reads these files"),
    (r"dronecats study rate\b", VEHICLE),
    (r"dronecats (bench --suite quick --pilot vision --latency trace:rig/|study run rig/)", RIG),
    (r"dronecats study loop .*--px4 ", PX4),
    (r"dronecats study run my-study\.toml", "a file of one's own; tests/study/test_page.py reads the page's"),
    (r"python -m benchmarks\.vision_errors ", "a run that vision flew; tests/benchmarks fits a small one"),
    (r"dronecats (bench|export) runs/learnt/", "448 flights, ten minutes; tests/examples flies and exports one"),
    (r"python -m examples\.action_head\.", LEARNT),
    (r"dronecats bench (--suite quick|residential-\S+ .*) --pilot oracle vision ", "dozens of flights, vision's too"),
    (r"dronecats bench my\.toml", "a file of one's own; tests/cli benches with some"),
    (r"dronecats models check", "a model's endpoint and key; tests/cli does it with endpoints of its own"),
    (r"dronecats fly --sitl --autopilot px4", PX4),
    (r"dronecats fly --sitl( --episode \S+ --pilot vision| --optics FILE\.toml)?$", REAL_TIME),
    (r"dronecats fly --sitl --pilot oracle --episode \S+$", REAL_TIME),
    (r"(echo ARM \| )?dronecats fly (--connect|…)", VEHICLE),
    (r"dronecats (preflight|camera|flightlog (list|fetch))\b", VEHICLE),
    (r"dronecats compare runs/ours runs/px4", PX4),
    (r"dronecats sitl --hitl", "a board"),
    (r"dronecats sitl\b|dronecats impair\b", FOREVER),
    (r"dronecats fly --sitl --episode \S+ --pilot vision --view$", "minutes in real time; tests/watch flies it"),
    (r"dronecats replay\b", "a browser's page, until it is interrupted; tests/playback does it"),
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
