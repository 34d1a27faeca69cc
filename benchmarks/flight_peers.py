"""The hover-and-step task in other simulators, each in its own virtual environment, timed in the same run as ours.

`compare` starts this file with the Python of each environment found; there it imports the peer and nothing of ours.
Environments: DIR/rotorpy, DIR/gym-pybullet-drones, DIR/PyFlyt and DIR/crazyflow, one package each.
"""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

SPIN_UP_STEPS = 50  # not timed: compilation and first allocations
LIMIT_S = 300


def timed(step: Callable[[int], None], steps: int, dt: float) -> dict[str, float]:
    """Return vehicle seconds per wall second and per processor second over `steps` calls of `step(number)`."""
    for i in range(SPIN_UP_STEPS):
        step(i)
    wall, cpu = time.perf_counter(), time.process_time()
    for i in range(steps):
        step(SPIN_UP_STEPS + i)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return {"rtf": round(steps * dt / wall, 2), "rtf_cpu": round(steps * dt / cpu, 2)}


def target(t: float) -> tuple[float, float, float]:
    """Return the place (m, up positive) to be at: hover, a step of 1 m, back, every 2 s."""
    return (1.0 if int(t / 2.0) % 2 else 0.0, 0.0, 1.0)


def rotorpy() -> dict[str, float]:
    import numpy as np
    from rotorpy.controllers.quadrotor_control import SE3Control
    from rotorpy.vehicles.crazyflie_params import quad_params
    from rotorpy.vehicles.multirotor import Multirotor

    vehicle, control, dt = Multirotor(quad_params), SE3Control(quad_params), 0.01
    world = {"state": dict(vehicle.initial_state)}
    zero = np.zeros(3)

    def step(i: int) -> None:
        flat = {"x": np.array(target(i * dt)), "yaw": 0.0, "yaw_dot": 0.0, "yaw_ddot": 0.0}
        flat |= dict.fromkeys(("x_dot", "x_ddot", "x_dddot", "x_ddddot"), zero)
        world["state"] = vehicle.step(world["state"], control.update(i * dt, world["state"], flat), dt)

    return timed(step, 1000, dt)


def gym_pybullet_drones() -> dict[str, float]:
    import numpy as np
    from gym_pybullet_drones.control.DSLPIDControl import DSLPIDControl
    from gym_pybullet_drones.envs.CtrlAviary import CtrlAviary
    from gym_pybullet_drones.utils.enums import DroneModel

    env = CtrlAviary(drone_model=DroneModel.CF2X, num_drones=1, pyb_freq=240, ctrl_freq=240, gui=False)
    control, dt = DSLPIDControl(drone_model=DroneModel.CF2X), 1.0 / 240.0
    env.reset()
    action = np.zeros((1, 4))

    def step(i: int) -> None:
        state = env.step(action)[0][0]
        action[0], _, _ = control.computeControlFromState(dt, state, target_pos=np.array(target(i * dt)))

    return timed(step, 2400, dt)


def pyflyt() -> dict[str, float]:
    import numpy as np
    from PyFlyt.core import Aviary

    env = Aviary(start_pos=np.array([[0.0, 0.0, 1.0]]), start_orn=np.zeros((1, 3)), drone_type="quadx")
    env.set_mode(7)  # x, y, yaw, z
    dt = 1.0 / 120.0

    def step(i: int) -> None:
        x, y, z = target(i * dt)
        env.set_setpoint(0, np.array([x, y, 0.0, z]))
        env.step()

    return timed(step, 1200, float(getattr(env, "update_period", dt)))


def crazyflow() -> dict[str, float]:
    import numpy as np
    from crazyflow.control import Control
    from crazyflow.sim import Sim

    sim = Sim(n_worlds=1, n_drones=1, freq=500, control=Control.state)
    sim.reset()
    command = np.zeros((1, 1, 13), np.float32)
    every = int(sim.freq // sim.control_freq)
    dt = every / sim.freq

    def step(i: int) -> None:
        command[0, 0, :3] = target(i * dt)
        sim.state_control(command)
        sim.step(every)

    return timed(step, 500, dt)


PEERS: dict[str, Callable[[], dict[str, float]]] = {
    "rotorpy": rotorpy,
    "gym-pybullet-drones": gym_pybullet_drones,
    "PyFlyt": pyflyt,
    "crazyflow": crazyflow,
}


def compare(folder: Path, core_rtf: float) -> dict[str, Any]:
    """Return per peer its times-real-time and ours divided by it, or a `note` on why it was skipped."""
    found: dict[str, Any] = {}
    for name in PEERS:
        python = folder / name / "bin" / "python"
        if not python.exists():
            found[name] = {"note": f"skipped: no virtual environment at {folder / name}"}
            continue
        try:
            done = subprocess.run([python, __file__, name], capture_output=True, text=True, timeout=LIMIT_S, check=True)
            found[name] = json.loads(done.stdout.splitlines()[-1])
            found[name]["ours_over_it"] = round(core_rtf / found[name]["rtf"], 1)
        except subprocess.TimeoutExpired:
            found[name] = {"note": f"skipped: took longer than {LIMIT_S} s"}
        except (subprocess.CalledProcessError, ValueError, IndexError, KeyError) as error:
            said = (getattr(error, "stderr", "") or str(error)).strip().splitlines()
            found[name] = {"note": f"skipped: {said[-1] if said else error}"}
    return found


if __name__ == "__main__":
    print(json.dumps(PEERS[sys.argv[1]]()))
