"""The unmodified MAVSDK-Python examples fly `dronecats sitl`; what they did is written to docs/compatibility.md.

    make compatibility EXAMPLES=.../MAVSDK-Python/examples MAVSDK3=.../bin/python

Each example has a simulator of its own, at the speed of the wall clock, which the examples sleep by. They all listen on
UDP port 14540: where the system lets a process have its own network, each pair gets one and some run at once.
"""

import json
import platform
import re
import shutil
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import pytest
from example_table import EXAMPLES, Example

pytestmark = [pytest.mark.compatibility, pytest.mark.slow, pytest.mark.timeout(1800)]

HERE = Path(__file__).parent
TABLE = HERE.parent.parent / "docs" / "compatibility.md"
START_S = 300.0  # beside the script's own limit: simulator, flight before it, ending
WRONG = re.compile(r"Traceback \(most recent call last\)|failed with error|\|Error +\]|exception was never retrieved")
OWN_NETWORK = ("unshare", "--map-root-user", "--net")
REASON = (
    "flies other people's scripts: give --examples MAVSDK-Python/examples and --mavsdk3 PYTHON (of an environment with "
    '"mavsdk<4", anyio and tqdm)'
)


@dataclass(frozen=True)
class Outcome:
    """What one example did."""

    example: Example
    fault: str  # "" when it worked
    seconds: float  # wall, of the script
    climbed_m: float | None  # highest point of the flight log above its start; None without a log
    lines: tuple[str, ...]


def own_network() -> tuple[str, ...]:
    """Return the command that gives a process its own network, () where there is none."""
    if not shutil.which("unshare") or not shutil.which("ip"):
        return ()
    tried = subprocess.run([*OWN_NETWORK, "ip", "link", "set", "lo", "up"], capture_output=True, check=False)
    return OWN_NETWORK if tried.returncode == 0 else ()


def climbed(state: Path) -> float | None:
    """Return how high above its start the vehicle of these logs has been, in m."""
    from pyulog import ULog

    heights = []
    for path in state.rglob("*.ulg"):
        for topic in ULog(str(path), ["vehicle_local_position"]).data_list:
            heights.append(float(topic.data["z"][0] - topic.data["z"].min()))
    return max(heights, default=None)


def fly(example: Example, folder: Path, python: Path, scratch: Path, network: tuple[str, ...]) -> Outcome:
    """Run one example to its end and return what it did."""
    where = scratch / example.name
    state = where / "state"
    state.mkdir(parents=True)
    for name in example.files:
        (where / Path(name).name).symlink_to(folder / name)
    for name, text in example.written.items():
        (where / name).write_text(text)
    task = {
        "python": str(python),
        "folder": str(folder),
        "example": asdict(example),
        "where": str(where),
        "state": str(state),
        "isolated": bool(network),
    }
    command = [*network, sys.executable, str(HERE / "example_stage.py"), json.dumps(task)]
    with (where / "stage.txt").open("wb") as errors:
        stage = subprocess.run(
            command, stdout=subprocess.PIPE, stderr=errors, timeout=2 * example.limit_s + START_S, check=False
        )
    if stage.returncode:
        pytest.fail(f"{example.name}: the stage fell: {(where / 'stage.txt').read_text()[-2000:]}")
    answer = json.loads(stage.stdout.splitlines()[-1])
    (where / "lines.txt").write_text("\n".join(answer["lines"]))
    height = climbed(state)
    return Outcome(example, _fault(example, answer, height), answer["seconds"], height, tuple(answer["lines"]))


def _fault(example: Example, answer: dict, height: float | None) -> str:
    text = "\n".join(answer["lines"])
    if example.refused:
        met = example.refused in text and all(re.search(pattern, text) for pattern in example.shows)
        return "" if met else f"was not refused with {example.refused}"
    if answer["outcome"] != "ok":
        return answer["outcome"]
    wrong = next((line for line in answer["lines"] if WRONG.search(line)), None)
    if wrong:
        return f"printed: {wrong.strip()} … {answer['lines'][-1].strip()}"
    if example.climbs_m and (height or 0.0) < example.climbs_m:
        return f"climbed {height or 0.0:.1f} m, not {example.climbs_m:.1f} m"
    return ""


@pytest.fixture(scope="module")
def outcomes(request, tmp_path_factory):
    """Every example's outcome, by script; the flights go on while the first are judged."""
    folder, python = request.config.getoption("--examples", None), request.config.getoption("--mavsdk3", None)
    if folder is None or python is None:
        pytest.skip(REASON)
    assert (folder / "takeoff_and_land.py").is_file(), f"no MAVSDK-Python examples in {folder}"
    assert python.is_file(), f"no such python: {python}"
    network = own_network()
    wanted = {item.callspec.params["script"] for item in request.session.items if hasattr(item, "callspec")}
    scratch = tmp_path_factory.mktemp("compatibility")
    pool = ThreadPoolExecutor(request.config.getoption("--at-once") if network else 1)
    longest_first = sorted(EXAMPLES, key=lambda example: -example.limit_s)
    futures: dict[str, Future[Outcome]] = {
        example.script: pool.submit(fly, example, folder.absolute(), python.absolute(), scratch, network)
        for example in longest_first
        if example.script in wanted
    }
    yield futures
    pool.shutdown(cancel_futures=True)
    if len(futures) == len(EXAMPLES) and all(future.done() and not future.exception() for future in futures.values()):
        TABLE.write_text(page([futures[example.script].result() for example in EXAMPLES], python))


@pytest.mark.parametrize("script", [example.script for example in EXAMPLES])
def test_an_example_does_what_it_shows(outcomes, script):
    outcome = outcomes[script].result()
    assert not outcome.fault, "\n".join([outcome.fault, *outcome.lines[-15:]])


def page(outcomes: list[Outcome], python: Path) -> str:
    """Return docs/compatibility.md."""
    versions = {}
    for name, interpreter in (
        ("mavsdk (the examples)", python),
        ("mavsdk", sys.executable),
        ("pymavlink", sys.executable),
    ):
        ask = f"from importlib.metadata import version; print(version({name.split()[0]!r}))"
        found = subprocess.run([interpreter, "-c", ask], capture_output=True, text=True, check=True)
        versions[name] = found.stdout.strip()
    rows = []
    for outcome in outcomes:
        example, notes = outcome.example, []
        if example.climbs_m and outcome.climbed_m is not None:
            notes.append(f"climbed {outcome.climbed_m:.1f} m")
        if example.endless:
            notes.append("endless: interrupted after it had shown what it shows")
        if example.note:
            notes.append(example.note)
        state = (
            f"**fails**: {outcome.fault}".replace("|", "/")
            if outcome.fault
            else ("refused, rightly" if example.refused else "works")
        )
        rows.append(f"| {example.script} | {example.plugins} | {example.expectation} | {state} | "
                    f"{outcome.seconds:.0f} | {'; '.join(notes)} |")  # fmt: skip
    good = sum(not outcome.fault for outcome in outcomes)
    return f"""# Other people's clients

The examples of [MAVSDK-Python](https://github.com/mavlink/MAVSDK-Python), unmodified, against `dronecats sitl` at the speed of
the wall clock, a fresh simulator each: **{good} of {len(outcomes)}** do what they show. An example works when it prints
every line it is known for, prints no error and no traceback, ends with status 0 (an endless one is interrupted once it has
shown everything), and, where it flies, the vehicle's own log has the climb. *core* and *yes* say how much a PX4-like
autopilot is expected to serve it.

| example | plugins | expected | outcome | seconds | note |
| --- | --- | --- | --- | --- | --- |
{chr(10).join(rows)}

Client of the examples: mavsdk {versions["mavsdk (the examples)"]} (its last release with gRPC). Python {platform.python_version()}, {platform.system()} {platform.machine()}.

Two more clients fly in the test suite on every run: mavsdk {versions["mavsdk"]}, whose API is another one, and pymavlink
{versions["pymavlink"]} alone (`tests/flight/test_clients.py`), and both a pymavlink agent and a pymavlink ground station at once
(`tests/compatibility/test_two_clients.py`).

This page is written by the test that flies them:

```
python -m venv older && older/bin/pip install "mavsdk<4" anyio tqdm
make compatibility EXAMPLES=MAVSDK-Python/examples MAVSDK3=older/bin/python
```
"""
