"""Flies the hover-and-step task in other simulators (peers), each in its own virtual environment, and times them.

`compare` runs this file with the Python of each environment that exists. There the file imports only the peer and
nothing of this project.
Environments: DIR/rotorpy, DIR/gym-pybullet-drones, DIR/PyFlyt and DIR/crazyflow, one package each.
"""

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

HEIGHT_M = 1.0
STEP_S = 2.0
UNTIMED_S = 8.0  # s of vehicle time before the timing starts: two periods of the task
REPEAT = 3
LIMIT_S = 300  # wall s, after which a peer is stopped


Place = tuple[float, float, float]  # m, up positive


def target(t: float) -> Place:
    """Return the target at `t` (s): every 2 s it steps by 1 m, away and back."""
    return (1.0 if int(t / STEP_S) % 2 else 0.0, 0.0, HEIGHT_M)


def timed(step: Callable[[int], Place], dt: float, seconds: float) -> dict[str, float]:
    """Return the vehicle seconds per wall second and per processor second, and the rate of the steps (Hz).

    The speeds are medians of `REPEAT` flights of `seconds` each. `step(number)` advances by `dt` (s) and returns the
    vehicle's place. The first `UNTIMED_S` are for compiling, allocating and climbing. Raises RuntimeError if the
    vehicle then deviates from the task by more than 0.5 m, or does not move as the task demands, because its time would
    not be comparable.
    """
    number, steps = round(UNTIMED_S / dt), round(seconds / dt)
    for i in range(number):
        step(i)
    places, walls, cpus = [], [], []
    for _ in range(REPEAT):
        wall, cpu = time.perf_counter(), time.process_time()
        for i in range(number, number + steps):
            places.append(step(i))
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
        number += steps
    _check(places)
    vehicle_s = steps * dt
    return {
        "rtf": round(vehicle_s / statistics.median(walls), 2),
        "rtf_cpu": round(vehicle_s / statistics.median(cpus), 2),
        "control_hz": round(1.0 / dt),
    }


def _check(places: list[Place]) -> None:
    spans = [(float(min(axis)), float(max(axis))) for axis in zip(*places, strict=True)]
    (near, far), (left, right), (low, high) = spans
    stepped = -0.5 < near < 0.3 and 0.7 < far < 1.5
    if not (stepped and left > -0.5 and right < 0.5 and low > HEIGHT_M - 0.5 and high < HEIGHT_M + 0.5):
        ranges = ", ".join(f"{least:.2f} to {most:.2f} m" for least, most in spans)
        raise RuntimeError(f"it did not fly the task: {ranges}")


def rotorpy() -> dict[str, float]:
    import numpy as np
    from rotorpy.controllers.quadrotor_control import SE3Control
    from rotorpy.vehicles.crazyflie_params import quad_params
    from rotorpy.vehicles.multirotor import Multirotor

    vehicle, control, dt = Multirotor(quad_params), SE3Control(quad_params), 0.01
    world = {"state": dict(vehicle.initial_state)}
    zero = np.zeros(3)

    def step(i: int) -> Place:
        flat = {"x": np.array(target(i * dt)), "yaw": 0.0, "yaw_dot": 0.0, "yaw_ddot": 0.0}
        flat |= dict.fromkeys(("x_dot", "x_ddot", "x_dddot", "x_ddddot"), zero)
        world["state"] = vehicle.step(world["state"], control.update(i * dt, world["state"], flat), dt)
        return tuple(world["state"]["x"])

    return timed(step, dt, 8.0)


def gym_pybullet_drones() -> dict[str, float]:
    import numpy as np
    from gym_pybullet_drones.control.DSLPIDControl import DSLPIDControl
    from gym_pybullet_drones.envs.CtrlAviary import CtrlAviary
    from gym_pybullet_drones.utils.enums import DroneModel

    rate = 240  # Hz, rate of physics and control: the peer's default
    env = CtrlAviary(drone_model=DroneModel.CF2X, num_drones=1, pyb_freq=rate, ctrl_freq=rate, gui=False)
    control, dt = DSLPIDControl(drone_model=DroneModel.CF2X), 1.0 / rate
    env.reset()
    action = np.zeros((1, 4))

    def step(i: int) -> Place:
        state = env.step(action)[0][0]
        action[0], _, _ = control.computeControlFromState(dt, state, target_pos=np.array(target(i * dt)))
        return tuple(state[:3])

    return timed(step, dt, 8.0)


def pyflyt() -> dict[str, float]:
    import numpy as np
    from PyFlyt.core import Aviary

    env = Aviary(start_pos=np.array([[0.0, 0.0, HEIGHT_M]]), start_orn=np.zeros((1, 3)), drone_type="quadx")
    env.set_mode(7)  # x, y, yaw, z
    dt = float(env.step_period)  # s, period of the controller; the physics runs at twice the controller's rate

    def step(i: int) -> Place:
        x, y, z = target(i * dt)
        env.set_setpoint(0, np.array([x, y, 0.0, z]))
        env.step()
        return tuple(env.state(0)[3])

    return timed(step, dt, 16.0)


def crazyflow() -> dict[str, float]:
    import numpy as np
    from crazyflow.control import Control
    from crazyflow.sim import Sim

    sim = Sim(n_worlds=1, n_drones=1, freq=500, control=Control.state)
    sim.reset()
    command = np.zeros((1, 1, 16), np.float32)  # place, velocity, acceleration, quaternion (x, y, z, w), body rates
    command[..., 12] = 1.0
    every = int(sim.freq // sim.control_freq)
    dt = every / sim.freq

    def step(i: int) -> Place:
        command[0, 0, :3] = target(i * dt)
        sim.state_control(command)
        sim.step(every)
        return tuple(np.asarray(sim.data.states.pos)[0, 0])  # `asarray` waits for JAX, which computes asynchronously

    return timed(step, dt, 16.0)


PEERS: dict[str, Callable[[], dict[str, float]]] = {
    "rotorpy": rotorpy,
    "gym-pybullet-drones": gym_pybullet_drones,
    "PyFlyt": pyflyt,
    "crazyflow": crazyflow,
}


def compare(folder: Path, core_rtf: float, core_rtf_cpu: float) -> dict[str, Any]:
    """Return for each peer its real-time factor, and our factor divided by it; or a `note` on why it was skipped.

    `core_rtf`, `core_rtf_cpu`: our factor by wall and by processor time. If other programs run too, use only `…_cpu`.
    """
    results: dict[str, Any] = {}
    this = Path(__file__).absolute()
    for name in PEERS:
        python = folder.absolute() / name / "bin" / "python"
        if not python.exists():
            results[name] = {"note": f"skipped: no virtual environment at {folder / name}"}
            continue
        try:
            done = subprocess.run(
                [python, this, name], cwd=folder, capture_output=True, text=True, timeout=LIMIT_S, check=True
            )  # some peers write logs into the working folder
            results[name] = json.loads(done.stdout.splitlines()[-1])
            results[name]["ours_over_it"] = round(core_rtf / results[name]["rtf"], 1)
            results[name]["ours_over_it_cpu"] = round(core_rtf_cpu / results[name]["rtf_cpu"], 1)
        except subprocess.TimeoutExpired:
            results[name] = {"note": f"skipped: took longer than {LIMIT_S} s"}
        except (subprocess.CalledProcessError, ValueError, IndexError, KeyError) as error:
            lines = (getattr(error, "stderr", "") or str(error)).strip().splitlines()
            results[name] = {"note": f"skipped: {lines[-1] if lines else error}"}
    return results


if __name__ == "__main__":
    print(json.dumps(PEERS[sys.argv[1]]()))
