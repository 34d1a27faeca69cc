"""Verb `sitl`: runs only the simulator, on PX4's ports, for any MAVLink client.

The autopilot is this project's own, or PX4.
"""

import argparse
import contextlib
import tempfile
from pathlib import Path

from dronecats.cli.exit_status import interrupt_on_signals
from dronecats.cli.next_commands import print_next
from dronecats.cli.options import DISTURBANCES, SIGN, add, add_view, key_of, speed, view_of
from dronecats.cli.output import print_line
from dronecats.flight.processes.supervisor import Supervisor
from dronecats.flight.spec.disturbances import UNDISTURBED
from dronecats.view.live.config import WatchedWires
from dronecats.view.live.opening import opened
from foundation.errors import UsageError

AIR = ("wind", "gusts")  # disturbances; in this verb they act from boot
SEEN = ("sun", "sky", "season")  # conditions that change only the camera's pictures
LEAST_CHARGE = 0.5  # the battery keeps this share of its charge (SIM_BAT_MIN_PCT), so a session has no time limit
PX4_INSTANCES = 10  # number of PX4 instances with their own offboard port; all further ones send to port 14549


def add_sitl_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--instance", type=int, default=0, metavar="I", help="add this to every port except 14550 (default 0)"
    )
    parser.add_argument("--count", type=int, metavar="N", help="number of vehicles, each on its own ports (default 1)")
    parser.add_argument("--speed", default="1", metavar="S", help="factor on real time (default 1)")
    parser.add_argument("--airframe", default="x500", metavar="NAME", help="name or TOML file (default x500)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the sensors' noise (default 0)")
    parser.add_argument("--episode", metavar="ID", help="use its map and start place (default: open ground)")
    parser.add_argument(
        "--camera",
        nargs="?",
        type=int,
        const=True,
        default=None,
        metavar="PORT",
        help="serve the camera over HTTP (default port 8080 + I, or the next free one; 0: any)",
    )
    parser.add_argument(
        "--state",
        type=Path,
        metavar="DIR",
        help="folder of parameters, plans, logs and clients' files (default runs/sitl-I)",
    )
    add(parser, (option for option in DISTURBANCES if option.name in (*AIR, *SEEN)))
    parser.add_argument("--optics", type=Path, metavar="FILE", help="with --camera: lens, noise, weather")
    parser.add_argument("--faults", type=Path, metavar="FILE", help="fault script: docs/disturbances.md")
    parser.add_argument(
        "--autopilot", choices=("ours", "px4"), default="ours", help="px4: a real PX4 flies (default ours)"
    )
    parser.add_argument(
        "--px4", metavar="COMMAND", help="with --autopilot px4: command that starts your PX4 (default: wait for one)"
    )
    add(parser, [SIGN])
    parser.add_argument("--hitl", metavar="URL", help="fly with a PX4 board: serial:///dev/ttyACM0:921600")
    add_view(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Simulate until Ctrl-C."""
    from episodes.camera.optics.file import load
    from episodes.records import catalogue

    factor = speed(args.speed)
    if factor is None:
        raise UsageError(
            "--speed max is lockstep, which waits for an agent of `dronecats fly`. For sitl use a factor"
            " such as 1 or 10"
        )
    if not 0 <= args.instance <= 99:
        raise UsageError(f"--instance must be 0 to 99, got {args.instance}")
    if args.count is not None and not 1 <= args.count <= 10:
        raise UsageError(f"--count must be 1 to 10 vehicles, got {args.count}")
    episode = args.episode or catalogue.OPEN_GROUND
    catalogue.load(episode)
    if args.seed < 0:
        raise UsageError(f"--seed must be 0 or more, got {args.seed}")
    disturbed = UNDISTURBED.with_options({name: getattr(args, name) for name in (*AIR, *SEEN)})
    if args.faults is not None and not args.faults.is_file():
        raise UsageError(f"--faults {args.faults} does not exist. Give the path of a TOML file")
    for name in ("optics", *SEEN):
        if getattr(args, name) is not None and args.camera is None:
            raise UsageError(f"--{name} goes with --camera. Add it, or leave --{name} out")
    default_camera = args.camera is True  # --camera without a port
    if args.camera is not None and not 0 <= args.camera <= 65535:
        raise UsageError(f"--camera {args.camera} is not a port. Choose one from 1 to 65535, or 0 for any free one")
    optics = load(args.optics).as_dict() if args.optics else None
    if args.px4 and args.autopilot != "px4":
        raise UsageError("--px4 goes with --autopilot px4. Add it, or leave --px4 out")
    if args.hitl:
        _check_hitl(args, factor)
    elif args.autopilot == "px4" and args.instance + (args.count or 1) > PX4_INSTANCES:
        raise UsageError(
            f"PX4 has separate offboard ports for the instances 0 to {PX4_INSTANCES - 1} only. Lower"
            " --instance or --count"
        )
    view = view_of(args)
    key_of(args.sign)
    if args.sign and (args.autopilot == "px4" or args.hitl):
        raise UsageError(
            "--sign cannot be used with --autopilot px4 or --hitl, because PX4 accepts no key from the simulator."
            " Leave --sign out"
        )
    if args.sign and view:
        raise UsageError("the page of --view reads unsigned telemetry only. Leave --view or --sign out")
    if view and view.stays:
        raise UsageError("the page always stays until Ctrl-C, as the simulator does. Leave --view-stay out")
    interrupt_on_signals()
    from dronecats.flight.sitl import compile_ahead

    print(f"loading core and camera{compile_ahead.compile_notice()} …", flush=True)
    from dronecats.flight.sitl.board_simulator import BoardSimulator
    from dronecats.flight.sitl.config import CameraConfig, SimulatorConfig
    from dronecats.flight.sitl.px4 import Px4Simulator
    from dronecats.flight.sitl.simulator_process import Simulator
    from dronecats.flight.sitl.sockets import CAMERA_PORT
    from dronecats.flight.stages.stage import CAMERA

    config = SimulatorConfig(
        episode=episode,
        least_charge=LEAST_CHARGE,
        airframe=args.airframe,
        seed=args.seed,
        speed=factor,
        instance=args.instance,
        count=args.count or 1,
        disturbances=disturbed.vehicle,
        from_boot=True,
        faults=str(args.faults) if args.faults else None,
        state_dir=str(args.state or Path("runs") / f"sitl-{args.instance}"),
        autopilot=args.autopilot,
        px4=args.px4,
        restart=True,
        sign=str(args.sign) if args.sign else None,
        hitl=args.hitl,
    )
    simulator: Simulator | Px4Simulator | BoardSimulator
    if args.hitl:
        simulator = BoardSimulator(config, notify=print_line)
    elif args.autopilot == "px4":
        simulator = Px4Simulator(config, notify=print_line)
    else:
        simulator = Simulator(config)
    with tempfile.TemporaryDirectory(prefix="dronecats-sitl-") as logs:
        supervisor = Supervisor(Path(logs))
        try:
            ports = simulator.ready()
            camera = None
            if args.camera is not None:
                truth = f"udpout://127.0.0.1:{ports['truth']}"
                watched = CameraConfig(
                    episode=episode,
                    airframe=args.airframe,
                    seed=args.seed,
                    count=args.count or 1,
                    truth=truth,
                    port=CAMERA_PORT + args.instance if default_camera else args.camera,
                    or_next_free=default_camera,
                    optics=optics,
                    conditions=disturbed.conditions.of_map,
                )
                child = supervisor.start(CAMERA, watched)
                camera = child.ready(lambda: None)["url"]
            _announce(args, camera)
            wires = WatchedWires(
                episode=episode,
                drones=args.count or 1,
                conditions=disturbed.conditions.of_map,
                truth=f"udpout://127.0.0.1:{ports['truth']}",
                telemetry=tuple(f"udpout://127.0.0.1:{port}" for port in ports.get("log", ())),
            )
            with opened(view, wires, "simulator", print_line):
                simulator.ready()
                while True:
                    simulator.turn()
                    supervisor.check()
                    if lag := simulator.pace.line():
                        print_line(lag)
        except KeyboardInterrupt:
            if isinstance(simulator, Px4Simulator):
                print_line(simulator.summary())
            return 0
        finally:
            with contextlib.suppress(KeyboardInterrupt):
                supervisor.close()
                simulator.close()


def _check_hitl(args: argparse.Namespace, factor: float) -> None:
    """Raise UsageError for options that do not work with --hitl. A board runs in real time, alone, with its own PX4."""
    from hil.simulator import sensor_period_us

    if factor != 1.0:
        raise UsageError("a board runs in real time. Leave --speed or --hitl out")
    if (args.count or 1) != 1:
        raise UsageError("one board flies one vehicle. Leave --count or --hitl out")
    if args.px4 or args.faults:
        raise UsageError(f"--{'px4' if args.px4 else 'faults'} does not go with --hitl. Leave one of them out")
    sensor_period_us(args.hitl)


def _announce(args: argparse.Namespace, camera: str | None) -> None:
    from dronecats.flight.sitl.sockets import AGENT_PORT, GCS_PORT, TRUTH_LOCAL, TRUTH_PORT
    from hil.simulator import PORT

    for index in range(args.count or 1):
        port = AGENT_PORT + args.instance + index
        behind = f"   PX4 on TCP port {PORT + args.instance + index}" if args.autopilot == "px4" else ""
        print(
            f"vehicle {index + 1}: offboard clients udpin://0.0.0.0:{port}   ground station on port {GCS_PORT}{behind}"
        )
    print(
        f"true state: sent to port {TRUTH_PORT + args.instance}; programs can also connect to port"
        f" {TRUTH_LOCAL + args.instance}"
    )
    if camera:
        print(f"camera: {camera}")
    print("example scripts: examples/mavsdk4.py, examples/mavsdk3.py (MAVSDK 3), examples/pymavlink_velocity.py")
    print("Ctrl-C ends it", flush=True)
    vehicle = [f"udpin://0.0.0.0:{AGENT_PORT + args.instance}", *(["--sign", str(args.sign)] if args.sign else [])]
    if camera:
        print_next("sitl --camera", vehicle=vehicle, camera=camera)
    else:
        print_next("sitl", vehicle=vehicle)
