"""The same seed gives the same bytes, independent of the grouping of the steps."""

from numba import njit

from tests.vehicles.fleet import HIGH, vehicle
from vehicles.multirotor import Multirotor, step
from vehicles.wind import Wind


@njit
def _fused(steps, actuators, args):
    for _ in range(steps):
        actuators.command[0] = 0.70  # an autopilot would write here
        step(*args)


def fly_chunks(seed: int, chunks: list[int]) -> Multirotor:
    craft = vehicle(seed=seed, position_ned=HIGH, wind=Wind((3.0, 1.0, 0.0), 8.0))
    craft.actuators["armed"] = 1
    craft.actuators["command"][:4] = (0.70, 0.71, 0.70, 0.705)
    for steps in chunks:
        craft.advance(steps)
    return craft


def bytes_of(craft: Multirotor) -> bytes:
    return bytes(craft.record.tobytes())


def test_the_same_seed_gives_the_same_bytes() -> None:
    assert bytes_of(fly_chunks(7, [3000])) == bytes_of(fly_chunks(7, [3000]))
    assert bytes_of(fly_chunks(7, [3000])) == bytes_of(fly_chunks(7, [1, 999, 1500, 500]))


def test_another_seed_gives_another_flight() -> None:
    one, two = fly_chunks(7, [3000]), fly_chunks(8, [3000])
    assert one.truth["position_ned"].tobytes() != two.truth["position_ned"].tobytes()  # other gusts
    assert one.sensors["accel_frd"].tobytes() != two.sensors["accel_frd"].tobytes()


def test_the_sensor_rate_does_not_change_the_motion() -> None:
    craft, plain = fly_chunks(7, [3000]), vehicle(seed=7, position_ned=HIGH, wind=Wind((3.0, 1.0, 0.0), 8.0))
    plain.suite["imu_period_us"] = 4000
    plain.actuators["armed"] = 1
    plain.actuators["command"][:4] = (0.70, 0.71, 0.70, 0.705)
    plain.advance(3000)
    assert craft.truth.tobytes() == plain.truth.tobytes()


def test_a_copied_state_continues_identically() -> None:
    craft, twin = fly_chunks(7, [1000]), fly_chunks(8, [1000])
    for name in craft.record.dtype.names or ():
        twin.record[name] = craft.record[name]
    craft.advance(1000)
    twin.advance(1000)
    assert bytes_of(craft) == bytes_of(twin)


def test_time_counts_from_boot_in_microseconds() -> None:
    craft = vehicle()
    assert craft.state["time_us"] == 0
    craft.advance(1234)
    assert craft.state["time_us"] == craft.truth["time_us"] == 1_234_000


def test_a_compiled_loop_of_steps_gives_the_same_bytes() -> None:
    alone, carried = fly_chunks(7, [1000]), fly_chunks(7, [])
    _fused(1000, carried.actuators, carried.kernel_args)
    assert bytes_of(alone) == bytes_of(carried)
