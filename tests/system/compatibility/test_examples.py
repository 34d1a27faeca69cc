"""The unmodified MAVSDK-Python examples fly `dronecats sitl`. docs/compatibility.md gets the results.

    make compatibility EXAMPLES=.../MAVSDK-Python/examples MAVSDK3=.../bin/python

Each example has its own simulator in real time, because the examples sleep by the wall clock. All listen on UDP port
14540. If the system allows a process its own network, each pair gets one, and several pairs run at the same time.
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
from typing import Any

import numpy as np
import pytest

from tests.support.command_line import last_object
from tests.support.unused_parameters import section
from tests.system.compatibility.example_table import EXAMPLES, Example

pytestmark = [pytest.mark.compatibility, pytest.mark.slow, pytest.mark.timeout(1800)]

HERE = Path(__file__).parent
TABLE = HERE.parents[2] / "docs" / "compatibility.md"
START_S = 300.0  # added to the script's limit: start of the simulator, an earlier flight, end
WRONG = re.compile(r"Traceback \(most recent call last\)|failed with error|\|Error +\]|exception was never retrieved")
OWN_NETWORK = ("unshare", "--map-root-user", "--net")
REASON = (
    "no scripts of other projects; to enable: make compatibility EXAMPLES=MAVSDK-Python/examples MAVSDK3=PYTHON "
    '(of an environment with "mavsdk<4", anyio and tqdm)'
)


@dataclass(frozen=True)
class Outcome:
    """The result of one example."""

    example: Example
    fault: str  # "" if it works
    seconds: float  # wall-clock time of the script
    reach: tuple[float, float] | None  # height and distance from the start in the log, m; None without a log
    lines: tuple[str, ...]


def own_network() -> tuple[str, ...]:
    """Return the command that gives a process its own network; () if that is impossible."""
    if not shutil.which("unshare") or not shutil.which("ip"):
        return ()
    tried = subprocess.run([*OWN_NETWORK, "ip", "link", "set", "lo", "up"], capture_output=True, check=False)
    return OWN_NETWORK if tried.returncode == 0 else ()


def reach(state: Path) -> tuple[float, float] | None:
    """Return the greatest height and distance from the start in these logs, in m; None without a log."""
    from pyulog import ULog

    reached = []
    for path in state.rglob("*.ulg"):
        for topic in ULog(str(path), ["vehicle_local_position"]).data_list:
            north, east, down = (topic.data[axis] - topic.data[axis][0] for axis in "xyz")
            reached.append((float(-down.min()), float(np.hypot(north, east).max())))
    return max(reached, default=None)


def fly(example: Example, folder: Path, python: Path, scratch: Path, network: tuple[str, ...]) -> Outcome:
    """Run one example to its end and return its outcome."""
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
    answer = last_object(stage.stdout.decode())
    (where / "lines.txt").write_text("\n".join(answer["lines"]))
    reached = reach(state)
    fault = _fault(example, answer, reached[0] if reached else 0.0)
    if not fault and example.downloads:
        vehicle_logs = {path.read_bytes() for path in state.rglob("*.ulg")}
        downloaded = {path.read_bytes() for path in where.glob(example.downloads)}
        fault = "" if downloaded == vehicle_logs else "what it downloaded is not what the vehicle wrote"
    return Outcome(example, fault, answer["seconds"], reached, tuple(answer["lines"]))


def _fault(example: Example, answer: dict[str, Any], height: float) -> str:
    text = "\n".join(answer["lines"])
    if example.refused:
        met = example.refused in text and all(re.search(pattern, text) for pattern in example.shows)
        return "" if met else f"was not refused with {example.refused}"
    if answer["outcome"] != "ok":
        return str(answer["outcome"])
    wrong = next((line for line in answer["lines"] if WRONG.search(line)), None)
    if wrong:
        return f"printed: {wrong.strip()} … {answer['lines'][-1].strip()}"
    if height < example.climbs_m:
        return f"climbed {height:.1f} m, not {example.climbs_m:.1f} m"
    if height > example.stays_below_m:
        return f"climbed {height:.1f} m, more than {example.stays_below_m:.1f} m"
    if answer["hits"]:
        return f"ran into something: {answer['hits'][0]}"
    return ""


@pytest.fixture(scope="module")
def outcomes(request, tmp_path_factory):
    """The outcome of each example by script, as futures. Later flights continue while earlier ones are checked."""
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
def test_an_example_works(outcomes, script):
    outcome = outcomes[script].result()
    assert not outcome.fault, "\n".join([outcome.fault, *outcome.lines[-15:]])


def count(outcomes: list[Outcome]) -> str:
    """Return a sentence with the number of examples that work, without those rejected as expected."""
    good = [outcome for outcome in outcomes if not outcome.fault]
    refused = sum(outcome.example.refused is not None for outcome in good)
    works, failed = len(good) - refused, len(outcomes) - len(good)
    others = [f"{refused} {'is' if refused == 1 else 'are'} rejected, as expected"] * (refused > 0)
    others += [f"{failed} fails" if failed == 1 else f"{failed} fail"] * (failed > 0)
    return f"**{works} of {len(outcomes)}** examples work" + "".join(f"; {words}" for words in others) + "."


def test_an_example_rejected_as_expected_does_not_count_as_working():
    works = Outcome(EXAMPLES[0], "", 1.0, None, ())
    refused = next(Outcome(example, "", 1.0, None, ()) for example in EXAMPLES if example.refused)
    fails = Outcome(EXAMPLES[0], "ended with exit status 1", 1.0, None, ())
    assert count([works, works]) == "**2 of 2** examples work."
    assert count([works, refused]) == "**1 of 2** examples work; 1 is rejected, as expected."
    assert count([works, refused, fails, fails]) == "**1 of 4** examples work; 1 is rejected, as expected; 2 fail."


def page(outcomes: list[Outcome], python: Path) -> str:
    """Return docs/compatibility.md."""
    older = _version("mavsdk", python)
    rows = []
    for outcome in outcomes:
        example, notes = outcome.example, []
        if example.climbs_m and outcome.reach:
            notes.append(f"climbed {outcome.reach[0]:.1f} m, flew {outcome.reach[1]:.0f} m away")
        if example.endless:
            notes.append("endless, interrupted")
        if example.note:
            notes.append(example.note)
        state = "rejected, as expected" if example.refused else "works"
        if outcome.fault:
            state = f"**fails**: {outcome.fault}".replace("|", "/")
        rows.append(f"| {example.script} | {example.plugins} | {example.expectation} | {state} | "
                    f"{outcome.seconds:.0f} | {'; '.join(notes)} |")  # fmt: skip
    return f"""# Compatibility with clients of PX4

This page lists the examples of [MAVSDK-Python](https://github.com/mavlink/MAVSDK-Python) that run unmodified with
`dronecats sitl`, and the features of PX4 that the simulator lacks.

## Examples of MAVSDK-Python

{count(outcomes)}

An example works if it prints every expected line, prints no error and ends with status 0. Examples without an end are
interrupted after their last expected line. If the example flies, the vehicle must climb and must not collide. Each
example runs with a new simulator in real time, over an open field.

The column *expected* rates how important an example is for users of PX4: *core* is more important than *yes*. The
seconds are the running time of the script.

| example | plugins | expected | outcome | seconds | note |
| --- | --- | --- | --- | --- | --- |
{chr(10).join(rows)}

Client of the examples: mavsdk {older}, the gRPC client. Python {platform.python_version()}, {platform.system()}
{platform.machine()}.

The test suite also flies mavsdk {_version("mavsdk")}, which has another API, and pymavlink
{_version("pymavlink")}. A script for MAVSDK 3 fails under MAVSDK 4 with "System is not constructed directly".
There is a [script for each client](sitl.md#connect-a-client).

## Differences from PX4

{section()}

| subject | difference or rule |
| --- | --- |
| `MISSION_WRITE_PARTIAL_LIST` | the answer is UNSUPPORTED; PX4 does not answer |
| reboot | message intervals are reset; parameters, missions, geofence and rally points are kept |
| end of `dronecats sitl` | parameters, plans, logs and files stay in the folder of `--state` (default `runs/sitl-0`) |
| `SYSTEM_TIME` | is 2026-01-01 at boot, so that equal flights have equal logs. Sent only after the first GPS fix |
| MAVLink FTP | clients may make, rename and remove files, but only in `/fs/microsd`. Logs are in `/fs/microsd/log` |
| size of files by FTP | up to 64 MiB per file, 1 GiB and 4096 entries in all |
| place of these files on disk | `vehicle-N/card` in the folder of `sitl --state` |

## Make this page

<!-- test: setup -->
```sh
python -m venv older && older/bin/pip install "mavsdk<4" anyio tqdm
make compatibility EXAMPLES=MAVSDK-Python/examples MAVSDK3=older/bin/python
```
"""


def _version(package: str, interpreter: Path | str = sys.executable) -> str:
    ask = f"from importlib.metadata import version; print(version({package!r}))"
    return subprocess.run([interpreter, "-c", ask], capture_output=True, text=True, check=True).stdout.strip()
