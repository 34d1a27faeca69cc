"""Measures how fast the page of a large report opens in a real browser, and its size.

    python -m benchmarks.page [--json] [--embed] [--flights N] [--keep DIR] [--short]

Creates N artificial flights (by default nine pilots × eighty episodes) of 60 steps, each with a picture of 25 kB and a
reply of 500 characters. Writes their page and opens it from disk in a headless Chromium. The pilots share their logs
and pictures by hard links. `--short` takes seconds and only checks that every figure can be measured.
"""

import json
import math
import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.machine import Machine, benchmark_parser, print_figures
from dronecats.agent.prompt import Prompt
from dronecats.cli.exit_status import exit_status
from dronecats.report.page.index import write_page
from dronecats.report.results.collection import collect
from foundation import extras
from foundation.camera import encode
from foundation.run_folder import layout

PILOTS, STEPS, PERIOD_S = 9, 60, 2.6
MAPS = ("residential", "campus")
CELLS = ("approaching", "searching", "tracking", "search-and-track")  # episode kinds
TARGET = (90.0, 12.0, -1.0)  # m NED
WORDS = "the car stands beyond the crossing and the way to it is free " * 8
WAIT_S = 120.0
BROWSER_FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")

READY = """const done = arguments[0];
(function look() {
  const ready = document.documentElement.dataset.ready;
  const [opening] = performance.getEntriesByType("navigation");
  if (ready && opening.loadEventEnd) done([Number(ready), opening.loadEventEnd]);
  else setTimeout(look, 10);
})()"""
OPEN_FLIGHT_SCRIPT = """const [hash, done] = arguments;
const began = performance.now();
location.hash = hash;
(function look() {
  const image = document.querySelector(".view img");
  if (image && image.complete && image.naturalWidth) done(performance.now() - began);
  else setTimeout(look, 5);
})()"""


def write_artificial_runs(folder: Path, flights: int, steps: int) -> None:
    """Write runs with `flights` flights in total, of `steps` steps each."""
    pilots = min(PILOTS, flights)
    names = [f"{MAPS[k % 2]}-{CELLS[k // 2 % 4]}-{k // 8 + 1:02}" for k in range(math.ceil(flights / pilots))]
    first = folder / "pilot-0"
    frames = [_picture(k) for k in range(steps)]
    for name in names:
        _episode(first / name, frames)
    for pilot in range(pilots):
        run = folder / f"pilot-{pilot}"
        if pilot:
            shutil.copytree(first, run, copy_function=os.link)
        model = {"provider": "vllm", "name": f"pilot-{pilot}"}
        about = {"flight": {"model": model, "seed": 0}, "prompt_sha256": Prompt.load().digest}
        (run / layout.RUN).write_text(json.dumps(about))


def _picture(number: int) -> bytes:
    rng = np.random.default_rng(number)
    coarse = rng.integers(90, 160, (23, 40, 3), np.uint8)
    return encode(np.asarray(cv2.resize(coarse, (640, 360), interpolation=cv2.INTER_CUBIC), np.uint8))


def _episode(folder: Path, frames: list[bytes]) -> None:
    (folder / layout.FRAMES).mkdir(parents=True)
    map_name, _, rest = folder.name.partition("-")
    cell = rest.rpartition("-")[0]
    record = {"version": 1, "id": folder.name, "map": map_name, "map_seed": 1, "cell": cell, "instruction": "go there"}
    (folder / layout.EPISODE).write_text(json.dumps(record))
    decisions, truth = [], [json.dumps({"kind": "begin", "t": 0.0, "t0_us": 5, "cap_s": 300.0})]
    for step, frame in enumerate(frames):
        t = round(0.1 + step * PERIOD_S, 2)
        go = {"action": "go", "point": [(37.0 * step) % 1000.0, (91.0 * step) % 1000.0], "depth_m": 6.5 + step / 7}
        action = go if step % 3 else {"action": "rotate", "angle_deg": step - 30.0}
        action = {"action": "finished"} if step == len(frames) - 1 else action
        decisions.append(json.dumps({
            "step": step, "drone": 0, "frame_id": step, "t_frame": t, "t_decided": t + 0.5, "action": action,
            "reply": f"{step}: {WORDS}{json.dumps(action)}", "error": None, "latency_s": 0.5, "tokens_in": 1045,
            "tokens_out": 140, "thinking": False, "rate_hz": 0.38,
        }))  # fmt: skip
        truth.append(json.dumps({"kind": "frame", "frame_id": step, "bearing_deg": 4.0, "visible_fraction": 0.9,
                                 "oracle_depth_m": 9.0, "distance_box_m": 8.0, **_measured(t)}))  # fmt: skip
        (folder / layout.FRAMES / layout.frame_name(step)).write_bytes(frame)
    truth += [json.dumps({"kind": "pose", **_measured(k / 2)}) for k in range(int(2 * len(frames) * PERIOD_S))]
    truth.append(json.dumps({"kind": "end", "t": len(frames) * PERIOD_S, "reason": "decided", "error": None}))
    (folder / layout.DECISIONS).write_text("\n".join(decisions) + "\n")
    (folder / layout.TRUTH).write_text("\n".join(truth) + "\n")


def _measured(t: float) -> dict[str, Any]:
    place = (0.55 * t, 6.0 * math.sin(t / 9), -2.0)
    return {"t": t, "drone": 0, "position_ned": place, "yaw_deg": 5.0, "target_ned": TARGET,
            "distance_m": round(math.dist(place, TARGET), 4), "visible": True}  # fmt: skip


def opened(page: Path) -> dict[str, Any]:
    """Open a page, then a flight in it; return the milliseconds of both (browser's clock)."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for flag in BROWSER_FLAGS:
        options.add_argument(flag)
    with tempfile.TemporaryDirectory() as profile:
        options.add_argument(f"--user-data-dir={profile}")
        driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
        try:
            driver.set_script_timeout(WAIT_S)
            driver.get("about:blank")
            driver.get(page.as_uri())
            shown, loaded = driver.execute_async_script(READY)
            flight_ms = driver.execute_async_script(OPEN_FLIGHT_SCRIPT, "#pilot-0/campus-approaching-01/0")
        finally:
            driver.quit()
    return {"shown_ms": round(shown), "interactive_ms": round(max(shown, loaded)), "flight_ms": round(flight_ms)}


def figures(folder: Path, flights: int, steps: int, embed: bool) -> dict[str, Any]:
    """Return the size of a report of artificial flights in `folder`, and the times to write and open it."""
    machine = Machine()
    write_artificial_runs(folder / "runs", flights, steps)
    began = time.perf_counter()
    collection = collect([folder / "runs"])
    read = time.perf_counter()
    page = write_page(collection, [], folder / "report", embed=embed)
    written = time.perf_counter()
    opening_times = opened(page)
    machine.look()
    data = sum(path.stat().st_size for path in (folder / "report/data").rglob("*.js"))
    pictures = sum(path.stat().st_size for path in (folder / "report/pictures").rglob("*.jpg"))
    return {
        "machine": machine.figures(),
        "flights": len(collection.episodes),
        "embedded": embed,
        **opening_times,
        "page_mb": round(page.stat().st_size / 1e6, 2),
        "data_mb": round(data / 1e6, 1),
        "pictures_mb": round(pictures / 1e6, 1),
        "collected_s": round(read - began, 1),
        "written_s": round(written - read, 1),
    }


def main() -> int:
    """Print the figures; return the exit status."""
    parser = benchmark_parser(__doc__, short="use eighteen short flights, to check that it works")
    parser.add_argument("--embed", action="store_true", help="embed flights and pictures in the page")
    parser.add_argument("--flights", type=int, default=720, metavar="N", help="number of flights (default 720)")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="folder to keep runs and report")
    args = parser.parse_args()
    extras.require("selenium")
    flights, steps = (18, 6) if args.short else (args.flights, STEPS)
    with tempfile.TemporaryDirectory() as scratch:
        measured = figures(args.keep or Path(scratch), flights, steps, args.embed)
    print_figures(measured, args.json)
    return 0


if __name__ == "__main__":
    raise SystemExit(exit_status("benchmarks.page", main))
