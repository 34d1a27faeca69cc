"""The fused loop gives exactly the same flight as calls of plant and inner loop in turn."""

import pytest

from autopilot.control.flight_core import FlightCore, update
from dronecats.flight.sitl.fused import Fused
from vehicles import airframe
from vehicles.multirotor import Multirotor, step
from vehicles.wind import Wind

ORIGIN = (47.397742, 8.545594, 488.0)


def hopping(seed: int) -> tuple[Multirotor, FlightCore]:
    """Return a vehicle in a gusty wind with an order to climb."""
    frame = airframe.load("x500")
    plant = Multirotor(frame, seed=seed, origin=ORIGIN, wind=Wind((2.0, 1.0, 0.0), 3.0))
    core = FlightCore(frame)
    core.setpoint["armed"], core.setpoint["kind"], core.setpoint["thrust"] = 1, 2, 0.7
    core.setpoint["attitude"] = (1.0, 0.0, 0.0, 0.0)
    return plant, core


def test_the_fused_loop_equals_step_then_update_to_the_last_bit() -> None:
    (plant, core), (fused_plant, fused_core) = hopping(3), hopping(3)
    fused = Fused(fused_plant.kernel_args, fused_core.kernel_args(fused_plant.sensors, fused_plant.actuators))
    core_args = core.kernel_args(plant.sensors, plant.actuators)
    for milliseconds in (1, 10, 389):
        for _ in range(milliseconds):
            step(*plant.kernel_args)
            update(*core_args)
        fused.advance(milliseconds)
        assert fused_plant.record.tobytes() == plant.record.tobytes()
        assert fused_core.estimate.tobytes() == core.estimate.tobytes()
        assert fused_core.covariance.tobytes() == core.covariance.tobytes()
    assert fused_plant.truth["time_us"] == 400_000
    assert fused_plant.truth["position_ned"][2] < -0.05, "the vehicle has left the ground: the test compares a flight"


def test_a_wrong_record_among_the_arguments_is_rejected() -> None:
    plant, core = hopping(1)
    args = plant.kernel_args
    with pytest.raises(TypeError, match="changed"):
        Fused((plant.state, *args[1:]), core.kernel_args(plant.sensors, plant.actuators))
