"""Flies a scripted minute over bad connections (wires). Measures which ones the link survives, and the path error.

    python -m benchmarks.bad_wire [--json] [--only NAME …] [--seed N] [--short] [--px4 COMMAND | --to URL --truth URL]

Every row is a whole flight in real time over one wire: connecting, arming, take-off, a minute of velocities, turns and
holds, landing. Figures of a row:

    astray_m          largest distance between the true paths over this wire and over the perfect wire, at the same time
    end_m             this distance at the end of the minute
    cut_speed_mps     true speed two seconds after the cable was pulled
    heading_off_deg   error of the autopilot's heading at the start of the minute

A flight with a cut ends when the link comes back and finds the autopilot in Hold. This counts as survived. By
default each row starts a new simulator of this project, with its own autopilot or with the PX4 that COMMAND starts.
With --to, a running autopilot flies; its vehicle must be on the ground. Then `heading_off_deg` shows whether paths can
be compared: PX4's own simulation was up to 4° off in both directions. `--short` flies a part of the minute over the
perfect wire and a lossy one, in the project's simulator at three times real time. It only checks that everything runs.
"""

import argparse
import contextlib
import json
import math
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.machine import benchmark_parser
from dronecats.flight.processes.supervisor import Supervisor
from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.truth_listener import Listener
from dronecats.flight.stages.stage import SIMULATOR
from foundation.errors import DronecatsError, InfrastructureError
from foundation.frames import PX4_HOME, quat_yaw, wrap_pi
from foundation.mavlink import Parser, dialect
from foundation.setpoints import Hold, Setpoint, Turn, Velocity
from foundation.truth import TruthSample, truth_sample
from hil.impairment import ImpairedWire, Impairment
from hil.link.link import Link, TakeoverError
from hil.link.parameters import Parameters
from hil.link.transport import UdpTransport, connect

EPISODE = "campus-approaching-01"
SILENCE_S = 30.0  # s of wall time without a message until the link gives up (`fly --connect`: 6); longer than a cut
PROPOSED = {"COM_OBL_RC_ACT": 5.0, "COM_OF_LOSS_T": 0.5}  # set for rows with a cut: Hold after 0.5 s without setpoints
CUT_AT_S, CUT_S = 20.0, 10.0  # s: start of the cut in the minute, duration of the cut
MOVES: tuple[tuple[Setpoint, float], ...] = (
    (Velocity(1.2, None), 5.0),
    (Hold(), 2.0),
    (Turn(math.radians(60.0)), 1.5),
    (Hold(), 3.5),
)
MINUTE = MOVES * 5
SHORT_ROWS = ("perfect", "10 % loss")  # no delays, cuts, baud rates: these count wall time, but vehicle time is faster
SHORT_SPEED = 3.0


@dataclass(frozen=True, slots=True)
class Row:
    """The impairments of one wire in both directions."""

    name: str
    up: Impairment  # to the autopilot
    down: Impairment
    cut: bool = False


def symmetric(name: str, cut: bool = False, **impairment: Any) -> Row:
    return Row(name, Impairment(**impairment), Impairment(**impairment), cut)


ROWS = (
    symmetric("perfect"),
    symmetric("10 % loss", loss=0.10),
    symmetric("30 % loss", loss=0.30),
    symmetric("300 ms delay", delay_s=0.15),
    symmetric("600 ms delay", delay_s=0.30),
    symmetric("jitter 200 ms", jitter_s=0.2),
    symmetric("reordered, doubled", reorder=0.1, duplicate=0.1),
    symmetric("57,600 baud", baud=57_600),
    symmetric("1 byte in 1000 wrong", corrupt=0.001),
    symmetric("10 s cut", cut=True),
    symmetric(
        "all of them", cut=True, loss=0.10, delay_s=0.15, jitter_s=0.05, baud=57_600, reorder=0.02, duplicate=0.02
    ),
)


class Truth:
    """Listens to the truth bus on its own thread.

    PX4's own simulation sends samples without a time. They get the wall time of their arrival.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.samples: list[TruthSample] = []
        self._stamped = True
        self._parser, self._ending = Parser(), threading.Event()

    def __enter__(self) -> "Truth":
        self._listener = Listener(self.url, self._feed)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self._listener.close()

    def _listen(self) -> None:
        while not self._ending.is_set():
            self._listener.read(0.02)

    def _feed(self, data: bytes) -> None:
        for message in self._parser.feed(data):
            if message.get_msgId() == dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
                self._stamped = message.time_usec > 0
                message.time_usec = message.time_usec or _wall_us()
                self.samples.append(truth_sample(message, PX4_HOME))

    def now_us(self, vehicle_us: int) -> int:
        """Return the present moment on the clock of the samples."""
        return vehicle_us if self._stamped else _wall_us()

    def at(self, time_us: int) -> TruthSample:
        """Return the sample nearest to a time (µs) on the clock of the samples.

        Raises InfrastructureError if there are no samples.
        """
        if not self.samples:
            raise InfrastructureError(f"no truth arrives on {self.url}")
        return min(self.samples, key=lambda s: abs(s.time_us - time_us))


def _wall_us() -> int:
    return time.monotonic_ns() // 1000


@contextlib.contextmanager
def autopilot(args: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """Yield the URLs of an autopilot's link and of its truth bus."""
    if args.to:
        yield args.to, args.truth
        return
    with tempfile.TemporaryDirectory() as folder, contextlib.closing(Supervisor(Path(folder))) as supervisor:
        speed = SHORT_SPEED if args.short else 1.0
        px4 = bool(args.px4)
        simulator = supervisor.start(
            SIMULATOR,
            SimulatorConfig(
                episode=EPISODE, speed=speed, autopilot="px4" if px4 else "ours", px4=args.px4, log_dir=folder
            ),
        )
        ports = simulator.ready()
        while px4 and not simulator.do("in step"):
            time.sleep(0.1)
        way = "udpin" if px4 else "udpout"  # PX4 sends first, to a configured port
        yield f"{way}://127.0.0.1:{ports['agent'][0]}", f"udpout://127.0.0.1:{ports['truth']}"


Path3 = list[tuple[float, float, float]]


def fly(row: Row, args: argparse.Namespace) -> tuple[dict[str, Any], Path3]:
    """Return the figures of a flight, and its path: m ahead, right and down of the start, every 0.1 s.

    Ahead is along the heading that the autopilot estimates at the start. So a compass error does not count as an error
    of the path.
    """
    figures: dict[str, Any] = {"wire": row.name, "survived": False, "why": ""}
    path: Path3 = []
    moves = MOVES if args.short else MINUTE
    with autopilot(args) as (to, truth_url), Truth(truth_url) as truth:
        near = UdpTransport("udpin://127.0.0.1:0", "127.0.0.1", 0, listen=True)
        wire = ImpairedWire(near, connect(to), row.up, row.down, args.seed)
        url = f"udpout://127.0.0.1:{near.port}"
        link = Link(connect(url), silence_s=SILENCE_S)
        phase, t0_us, heading = "connecting", None, 0.0
        with wire:
            try:
                link.connect()
                phase = "waiting until the vehicle is ready"
                link.wait_for(lambda state: state.healthy, 90.0, "becoming ready to arm")
                if row.cut:
                    phase = "setting the parameters that preflight proposes"
                    for name, value in PROPOSED.items():
                        Parameters(link).set(name, value)
                phase = "arming"
                link.arm()
                phase = "taking off"
                link.order("take-off", dialect.MAV_CMD_NAV_TAKEOFF)
                link.wait_for(lambda s: s.mode == "HOLD" and s.landed is False, 60.0, "reaching take-off height")
                link.wait(3.0)
                phase = "entering offboard"
                link.fly(Hold())
                link.start_offboard()
                phase = "the minute"
                t0_us, heading = truth.now_us(link.time_us), link.state.euler[2] if link.state.euler else 0.0
                if row.cut:
                    wire.pull(wire.time_s + CUT_AT_S, CUT_S)
                for setpoint, seconds in moves:
                    link.fly(setpoint, seconds)
                    link.wait(seconds)
                phase = "landing"
                link.stop_offboard()
                link.set_mode("LAND")
                link.wait_for(lambda state: not state.armed, 60.0, "landing and disarming")
                figures["survived"] = True
            except TakeoverError as taken:  # expected after a cut: the autopilot holds
                figures["survived"], figures["why"] = row.cut, f"{phase}: {taken}"
            except DronecatsError as fault:
                figures["why"] = f"{phase}: {fault}"
            figures |= {"mode_at_the_end": link.state.mode, "up": str(wire.up.counts), "down": str(wire.down.counts)}
        link.close()
        if figures["why"]:
            rescue(to)
        if t0_us is not None:
            start = truth.at(t0_us)
            end_us = min(t0_us + round(1e6 * sum(seconds for _, seconds in moves)), truth.samples[-1].time_us)
            path = [_seen_from(start, heading, truth.at(time_us)) for time_us in range(t0_us, end_us, 100_000)]
            figures["heading_off_deg"] = round(math.degrees(wrap_pi(heading - quat_yaw(start.attitude))), 1)
            if row.cut:
                at_us = t0_us + round((CUT_AT_S + 2.0) * 1e6)
                figures["cut_speed_mps"] = round(math.hypot(*truth.at(at_us).velocity_ned), 2)
    return figures, path


def _seen_from(start: TruthSample, heading: float, sample: TruthSample) -> tuple[float, float, float]:
    """Return a sample's place relative to the start (m): ahead along `heading` (rad), right and down."""
    north, east, down = (p - s for p, s in zip(sample.position_ned, start.position_ned, strict=True))
    c, s = math.cos(heading), math.sin(heading)
    return c * north + s * east, c * east - s * north, down


def rescue(to: str) -> None:
    """Land a vehicle that is still in the air, over a good wire."""
    link = Link(connect(to))
    with contextlib.suppress(DronecatsError):
        link.connect()
        if link.state.armed:
            link.set_mode("LAND")
            link.wait_for(lambda state: not state.armed, 90.0, "landing")
    link.close()


def deviation(path: Path3, reference: Path3) -> dict[str, float]:
    """Return the largest and last distance (m) between a path and the reference at the same time."""
    distances = [math.dist(a, b) for a, b in zip(path, reference, strict=False)]
    return {"astray_m": round(max(distances), 2), "end_m": round(distances[-1], 2)} if distances else {}


def main() -> None:
    """Fly the rows and print a line for each."""
    parser = benchmark_parser(__doc__, short="fly one leg over two wires, to check that it runs")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="rows to fly; the perfect wire is always flown first")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--px4", metavar="COMMAND", help="command that starts a real PX4 in our physics, as in `fly --px4`"
    )
    parser.add_argument("--to", metavar="URL", help="a running autopilot, on the ground")
    parser.add_argument("--truth", metavar="URL", help="with --to: source of its HIL_STATE_QUATERNION")
    args = parser.parse_args()
    if bool(args.to) != bool(args.truth):
        parser.error("--to needs --truth, and --truth needs --to. Give both, or neither")
    if args.to and args.px4:
        parser.error("--px4 and --to both choose the autopilot. Leave one of them out")
    if args.short and (args.px4 or args.to):
        parser.error("--short flies in our own simulator. Leave --px4 and --to out")
    only = SHORT_ROWS if args.short else args.only
    reference: Path3 = []
    for row in ROWS:
        if only and row.name not in only and row is not ROWS[0]:
            continue
        figures, path = fly(row, args)
        reference = reference or path
        figures |= deviation(path, reference)
        print(json.dumps(figures, ensure_ascii=False) if args.json else line(figures), flush=True)


def line(figures: dict[str, Any]) -> str:
    keys = ("astray_m", "end_m", "cut_speed_mps", "heading_off_deg")
    text = " ".join(f"{key} {figures[key]:.2f}" for key in keys if key in figures)
    return f"{figures['wire']:22} {'survived' if figures['survived'] else 'LOST':9} {text}  {figures['why']}"


if __name__ == "__main__":
    main()
