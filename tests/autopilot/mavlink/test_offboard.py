"""Offboard: masks and frames, entering, losing and regaining the signal."""

import itertools
import math

import numpy as np
import pytest

from autopilot.mavlink.steering import RejectedError, trajectory
from autopilot.records import KIND_ATTITUDE, KIND_RATES
from foundation.frames import Quat, quat_from_euler
from foundation.mavlink import MODES, dialect
from tests.autopilot.commander_bench import ORIGIN, Bench
from tests.support.refusal import refusal


@pytest.fixture
def bench() -> Bench:
    bench = Bench(profile="minimal")
    bench.fly(10.0)
    return bench


def decode(mask: int, frame: int = 1, heading: float = 0.0, attitude: Quat | None = None):
    q = attitude or quat_from_euler(0.0, 0.0, heading)
    return trajectory(mask, frame, (1, 2, 3), (4, 5, 6), (7, 8, 9), 0.5, 0.6, q, heading)


def test_masks_of_real_clients_are_decoded() -> None:
    for mask, position, velocity, acceleration, yaw, yaw_rate in [
        (0x9C7, 0, 1, 0, 1, 0),
        (0x9F8, 1, 0, 0, 1, 0),
        (0x9C0, 1, 1, 0, 1, 0),
        (0x800, 1, 1, 1, 1, 0),
        (0xC3F, 0, 0, 1, 0, 0),
        (0x5C7, 0, 1, 0, 0, 1),
        (0xDC7, 0, 1, 0, 0, 0),
    ]:
        s = decode(mask)
        for is_set, values, sent in (
            (position, s.position_ned, (1, 2, 3)),
            (velocity, s.velocity_ned, (4, 5, 6)),
            (acceleration, s.acceleration_ned, (7, 8, 9)),
            (yaw, (s.yaw,), (0.5,)),
            (yaw_rate, (s.yaw_rate,), (0.6,)),
        ):
            assert values == sent if is_set else all(math.isnan(x) for x in values), (mask, sent)


def test_every_mask_gives_a_setpoint_or_a_reason() -> None:
    for mask, frame in itertools.product(range(0x1000), (1, 8)):
        # in body axes a vector must be complete or absent
        controlled = ~mask & 0x1FF if frame == 1 else not mask & 0x38 or not mask & 0x1C0
        if mask & 0x200 or not controlled:
            with pytest.raises(RejectedError):
                decode(mask, frame)
        else:
            decode(mask, frame)


def test_other_frames_are_unsupported() -> None:
    for frame in [f for f in range(22) if f not in (1, 8)]:
        assert str(frame) in refusal(decode, 0x9C7, frame, error=RejectedError)


def test_body_velocity_turns_with_the_heading_only() -> None:
    tilted = quat_from_euler(0.3, -0.2, math.pi / 2)
    s = decode(0x5C7, 8, math.pi / 2, tilted)
    assert s.velocity_ned == pytest.approx((-5.0, 4.0, 6.0))  # z stays world down
    assert s.yaw_rate == 0.6


def test_entering_offboard_needs_a_recent_setpoint(bench: Bench) -> None:
    client = bench.client
    assert client.mode(6) == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    client.velocity(0.0, 0.0, 0.0)
    assert client.mode(6) == dialect.MAV_RESULT_ACCEPTED  # one setpoint is enough
    assert client.of("HEARTBEAT")[-1].custom_mode == MODES["OFFBOARD"].custom_mode


def test_arming_in_offboard_needs_a_setpoint() -> None:
    bench = Bench(profile="minimal")
    assert bench.client.mode(6) == dialect.MAV_RESULT_ACCEPTED  # any mode is allowed while disarmed
    assert bench.client.arm() == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    bench.client.velocity(0.0, 0.0, -1.0)
    assert bench.client.arm() == dialect.MAV_RESULT_ACCEPTED
    bench.run(8.0, lambda: bench.client.velocity(0.0, 0.0, -1.0))
    assert bench.height > 2.0
    bench.until(lambda: not bench.commander.armed, 30.0, lambda: bench.client.velocity(0.0, 0.0, 1.0))
    assert any("after landing" in text for text in bench.client.texts())


def test_the_vehicle_follows_velocity_setpoints(bench: Bench) -> None:
    client = bench.client
    client.velocity(2.0, 0.0, 0.0)
    client.mode(6)
    bench.run(3.0, lambda: client.velocity(2.0, 0.0, 0.0))
    assert bench.velocity == pytest.approx([2.0, 0.0, 0.0], abs=0.05)
    bench.run(3.0, lambda: client.velocity(0.0, 1.0, -0.5, frame=1, mask=0x9C7))
    assert bench.velocity == pytest.approx([0.0, 1.0, -0.5], abs=0.05)


def lose(bench: Bench) -> None:
    bench.client.velocity(1.0, 0.0, 0.0)
    bench.client.mode(6)
    bench.run(1.0, lambda: bench.client.velocity(1.0, 0.0, 0.0))
    bench.client.velocity(1.0, 0.0, 0.0)
    bench.run(0.9)
    assert bench.commander.mode == "OFFBOARD"
    bench.run(0.2)


@pytest.mark.parametrize(
    ("choice", "mode"), [(0, "POSCTL"), (1, "ALTCTL"), (2, "STABILIZED"), (3, "RETURN"), (4, "LAND"), (5, "HOLD")]
)
def test_offboard_loss_triggers_the_configured_action_after_a_second(bench: Bench, choice: int, mode: str) -> None:
    bench.autopilot.parameters.set("COM_OBL_RC_ACT", choice)
    lose(bench)
    beat = bench.client.of("HEARTBEAT")[-1]
    assert (beat.custom_mode, beat.system_status) == (MODES[mode].custom_mode, dialect.MAV_STATE_CRITICAL)
    start = bench.height
    bench.run(4.0)
    if mode in ("POSCTL", "ALTCTL", "STABILIZED"):
        assert bench.velocity == pytest.approx([0.0, 0.0, 0.7], abs=0.05)  # measured on PX4: sinks at about 0.7 m/s
    elif mode == "HOLD":
        assert bench.height == pytest.approx(start, abs=0.1)
        assert bench.velocity == pytest.approx([0.0, 0.0, 0.0], abs=0.05)


def test_offboard_loss_can_disarm(bench: Bench) -> None:
    bench.autopilot.parameters.set("COM_OBL_RC_ACT", 7)
    lose(bench)
    assert not bench.commander.armed


def test_offboard_resumes_when_setpoints_return(bench: Bench) -> None:
    lose(bench)
    assert bench.commander.mode == "POSCTL"
    bench.client.velocity(1.0, 0.0, 0.0)
    bench.tick()
    assert bench.commander.mode == "OFFBOARD"
    bench.run(2.0, lambda: bench.client.velocity(1.0, 0.0, 0.0))
    assert bench.velocity[0] == pytest.approx(1.0, abs=0.05)
    assert not bench.commander.in_failsafe
    bench.run(1.2)  # a second loss is detected
    assert bench.commander.mode == "POSCTL"


def test_another_mode_ends_the_failsafe_and_later_losses_trigger_it_again(bench: Bench) -> None:
    lose(bench)
    assert bench.client.mode(4, 3) == 0
    bench.run(1.0)
    assert bench.commander.mode == "HOLD"
    assert not bench.commander.in_failsafe
    bench.client.velocity(1.0, 0.0, 0.0)
    bench.tick()
    assert bench.commander.mode == "HOLD"  # OFFBOARD was not requested
    lose(bench)
    assert bench.commander.mode == "POSCTL"


@pytest.mark.parametrize(("rate", "held"), [(1.1, True), (0.9, False)])
def test_setpoint_streams_below_1_hz_alternate_between_offboard_and_failsafe(
    bench: Bench, rate: float, held: bool
) -> None:
    bench.client.velocity(0.0, 0.0, 0.0)
    bench.client.mode(6)
    modes = set()
    for _ in range(6):
        bench.client.velocity(0.0, 0.0, 0.0)
        for _ in range(round(50 / rate)):
            bench.tick()
            modes.add(bench.commander.mode)
    assert modes == ({"OFFBOARD"} if held else {"OFFBOARD", "POSCTL"})


@pytest.mark.parametrize(("mask", "frame"), [(0x5E7, 8), (0xDFF, 8), (0xDFF, 1), (0xFC7, 8), (0x5C7, 9), (0x5C7, 12)])
def test_rejected_setpoints_do_not_keep_offboard_active(bench: Bench, mask: int, frame: int) -> None:
    bench.client.velocity(0.0, 0.0, 0.0)
    bench.client.mode(6)
    bench.client.forget()
    bench.run(1.5, lambda: bench.client.velocity(1.0, 0.0, 0.0, mask=mask, frame=frame))
    assert bench.commander.mode == "POSCTL"
    texts = [t for t in bench.client.texts() if t.startswith("SET_POSITION_TARGET_LOCAL_NED")]
    assert 1 <= len(texts) <= 3  # reported, but not 20 times a second


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 3e38])
def test_unusable_velocities_stop_the_vehicle_in_offboard(bench: Bench, bad: float) -> None:
    bench.client.velocity(2.0, 0.0, 0.0)
    bench.client.mode(6)
    bench.run(2.0, lambda: bench.client.velocity(2.0, 0.0, 0.0))
    bench.run(3.0, lambda: bench.client.velocity(bad, 0.0, 0.0))
    assert bench.commander.mode == "OFFBOARD"
    assert bench.velocity == pytest.approx([0.0, 0.0, 0.0], abs=0.05)


@pytest.mark.parametrize("far", [2e6, 3.4e38])
def test_the_vehicle_flies_towards_a_position_beyond_any_range(bench: Bench, far: float) -> None:
    def ask() -> None:
        bench.client.send(
            dialect.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0x9F8, far, -far, -10.0, 0, 0, 0, 0, 0, 0, 0.0, 0.0
            )
        )

    ask()
    bench.client.mode(6)
    bench.run(3.0, ask)
    assert bench.commander.mode == "OFFBOARD"
    limit = float(bench.autopilot.parameters["MPC_XY_VEL_MAX"])
    assert bench.velocity == pytest.approx([limit, -limit, 0.0], abs=0.1)  # the bench's core limits each axis
    assert bench.autopilot.node.handler_errors == 0


def test_global_setpoints_use_amsl_or_relative_altitude(bench: Bench) -> None:
    def fly(frame: int, altitude: float) -> None:
        lat = round((ORIGIN[0] + math.degrees(8.0 / 6371000.0)) * 1e7)
        message = dialect.MAVLink_set_position_target_global_int_message(
            0, 1, 1, frame, 0x9F8, lat, round(ORIGIN[1] * 1e7), altitude, 0, 0, 0, 0, 0, 0, 0.0, 0.0
        )
        bench.client.send(message)

    for frame, altitude in ((5, ORIGIN[2] + 12.0), (6, 9.0)):
        fly(frame, altitude)
        bench.client.mode(6)
        bench.run(15.0, lambda f=frame, a=altitude: fly(f, a))  # type: ignore[misc]
        height = altitude - ORIGIN[2] if frame == 5 else altitude
        assert bench.core.estimate["position_ned"] == pytest.approx([8.0, 0.0, -height], abs=0.2)
    bench.run(1.5, lambda: fly(11, 5.0))  # terrain altitude needs a range sensor, so the setpoint is rejected
    assert bench.commander.mode == "POSCTL"


def test_a_global_setpoint_without_a_position_needs_no_altitude_reference(bench: Bench) -> None:
    def fly(frame: int, mask: int) -> None:
        bench.client.send(
            dialect.MAVLink_set_position_target_global_int_message(
                0, 1, 1, frame, mask, 0, 0, 0.0, 2.0, 0, 0, 0, 0, 0, 0.0, 0.0
            )
        )

    fly(11, 0x9C7)  # the vehicle is too high for its rangefinder
    assert bench.client.mode(6) == 0
    bench.run(3.0, lambda: fly(11, 0x9C7))
    assert bench.velocity == pytest.approx([2.0, 0.0, 0.0], abs=0.05)
    fly(8, 0x9F8)
    assert any("SET_POSITION_TARGET_GLOBAL_INT coordinate frame 8" in text for text in bench.client.texts())


def attitude(bench: Bench, mask: int, q: list[float], rates: tuple[float, float, float], thrust: float) -> None:
    bench.client.send(dialect.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, *rates, thrust))


def test_attitude_and_rate_setpoints_reach_the_core_if_valid(bench: Bench) -> None:
    q = [*quat_from_euler(0.1, 0.2, 0.3)]
    attitude(bench, 0x7, [2 * x for x in q], (9, 9, 9), 0.6)
    bench.client.mode(6)
    bench.tick()
    record = bench.core.setpoint
    assert record["kind"] == KIND_ATTITUDE
    assert np.allclose(record["attitude"], q)
    assert (record["yaw_rate"], record["thrust"]) == (0.0, pytest.approx(0.6))
    attitude(bench, 0x80, [0, 0, 0, 0], (0.1, 0.2, 0.3), 0.4)
    bench.tick()
    assert record["kind"] == KIND_RATES
    assert np.allclose(record["rates_frd"], (0.1, 0.2, 0.3))
    bench.client.forget()
    attitude(bench, 0x7, [0, 0, 0, 0], (0, 0, 0), 0.4)
    attitude(bench, 0x7, [math.nan] * 4, (0, 0, 0), 0.4)
    attitude(bench, 0x83, q, (0, 0, 0), 0.4)
    attitude(bench, 0x7, q, (0, 0, 0), math.nan)
    bench.tick()
    assert record["kind"] == KIND_RATES  # all four were rejected
    assert bench.client.texts()
