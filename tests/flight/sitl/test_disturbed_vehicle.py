"""A vehicle with a bad link, wind, a payload and late GPS fixes. Each effect is checked against the truth."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle, Simulation
from dronecats.flight.spec.disturbances import UNDISTURBED, VehicleFaults
from dronecats.flight.stages.lockstep import Lockstep
from foundation.frames import GRAVITY, quat_to_euler, wrap_pi
from foundation.mavlink import dialect
from foundation.setpoints import Hold, Turn, Velocity
from hil.impairment import PERFECT, Impairment, SteppedWire
from hil.link.envelope import SIMULATED
from hil.link.link import Link
from vehicles import airframe

ORIGIN = (47.397742, 8.545594, 488.0)
X500 = airframe.load("x500")


@dataclass
class Aloft:
    """A vehicle that holds its position in offboard, and its recorded state at every tick from `begin` on."""

    vehicle: SimulatedVehicle
    wire: SteppedWire
    link: Link
    lockstep: Lockstep
    times_s: list[float] = field(default_factory=list)
    attitudes: list[tuple[float, float, float]] = field(default_factory=list)  # rad, roll pitch yaw
    places: list[np.ndarray] = field(default_factory=list)  # m, true
    errors: list[np.ndarray] = field(default_factory=list)  # m, estimate minus truth, minus its first value

    def begin(self) -> None:
        """Start the disturbances and the recording."""
        self.lockstep.simulation.begin(self.vehicle.time_us)
        self._off = self._error()
        self.lockstep.followers.append(self._note)

    def shot(self) -> tuple[int, np.ndarray, float]:
        """Return the link's time (µs), and the autopilot's estimate of its position and heading (m, rad)."""
        now = self.vehicle.core.estimate
        return self.link.time_us, now["position_ned"].copy(), quat_to_euler(tuple(now["attitude"].tolist()))[2]

    def _error(self) -> np.ndarray:
        return np.asarray(self.vehicle.core.estimate["position_ned"] - self.vehicle.plant.truth["position_ned"])

    def _note(self) -> None:
        truth = self.vehicle.plant.truth
        self.times_s.append(self.lockstep.now_s())
        self.attitudes.append(quat_to_euler(tuple(truth["attitude"].tolist())))
        self.places.append(truth["position_ned"].copy())
        self.errors.append(self._error() - self._off)


def aloft(payload_kg: float = 0.0, disturbances: VehicleFaults = UNDISTURBED.vehicle, wired: bool = True) -> Aloft:
    vehicle = SimulatedVehicle(0, X500, BootPose((0.0, 0.0, 0.0), 0.0), seed=5, origin=ORIGIN, payload_kg=payload_kg)
    lockstep = Lockstep(Simulation([vehicle], disturbances=disturbances))
    wire = lockstep.wire(0, seed=5)
    transport = wire if wired else lockstep.transport(0)
    link = Link(transport, simulated=True, silence_s=1e9)
    link.connect()
    link.wait_for(lambda state: state.healthy, 60.0, "becoming ready")
    link.arm()
    link.order("take-off", dialect.MAV_CMD_NAV_TAKEOFF)
    link.wait(8.0)
    link.fly(Hold())
    link.start_offboard()
    link.wait(6.0)
    return Aloft(vehicle, wire, link, lockstep)


def noses_down_after_s(flight: Aloft) -> float:
    """Return the seconds from the order to fly ahead until the true pitch is 2° below its first value."""
    flight.begin()
    flight.link.wait(2.0)
    asked_s, level = flight.lockstep.now_s(), flight.attitudes[-1][1]
    flight.link.fly(Velocity(3.0, None), 20.0)
    flight.link.wait(3.0)
    down = next(
        t for t, (_, pitch, _) in zip(flight.times_s, flight.attitudes, strict=True)
        if t > asked_s and pitch < level - math.radians(2.0)
    )  # fmt: skip
    return down - asked_s


def test_link_delay_postpones_setpoints_and_the_clock_stays_right() -> None:
    took_s = []
    for up, down in ((0.0, 0.0), (0.4, 0.0), (0.0, 0.3)):
        flight = aloft()
        flight.wire.impair(Impairment(delay_s=up), Impairment(delay_s=down), 1e9)
        flight.link.behind_us = round(down * 1e6)
        took_s.append(noses_down_after_s(flight))
        assert flight.link.time_us / 1e6 == pytest.approx(flight.lockstep.now_s(), abs=0.02)
    assert took_s[1] - took_s[0] == pytest.approx(0.4, abs=0.03)
    assert took_s[2] - took_s[0] == pytest.approx(0.0, abs=0.06)  # only telemetry is late: the order arrives at once


@pytest.mark.parametrize("late_s", [0.0, 1.0])
def test_the_pose_of_a_picture_is_right_even_with_late_telemetry(late_s: float) -> None:
    flight = aloft()
    flight.begin()
    flight.wire.impair(PERFECT, Impairment(delay_s=late_s), 1e9)
    flight.link.behind_us = round(late_s * 1e6)
    flight.link.wait(3.0)
    limited: list[tuple[str, ...]] = []
    flight.link.limits, flight.link.on_limit = SIMULATED, limited.append
    flight.link.fly(Velocity(1.2, None), 30.0)
    flight.link.wait(4.0)
    moving = flight.shot()
    flight.link.wait(2.5)
    flight.link.fly(Turn(0.5, None), 30.0)
    flight.link.wait(3.0)
    turning = flight.shot()
    flight.link.wait(2.5)
    for time_us, place, heading in (moving, turning):  # all telemetry of that time has arrived
        sight = flight.link.sight(time_us)
        assert sight.position_ned == pytest.approx(place.tolist(), abs=0.03)
        assert wrap_pi(sight.heading - heading) == pytest.approx(0.0, abs=0.03)
    assert limited in ([], [()])  # a position that is as late as all telemetry is not stale


def test_link_impairment_repeats_to_the_byte_and_has_no_effect_before_it_begins() -> None:
    plain, perfect = aloft(wired=False), aloft()
    assert plain.vehicle.plant.record.tobytes() == perfect.vehicle.plant.record.tobytes()
    records = []
    for loss in (0.0, 0.4, 0.4):
        flight = aloft()
        assert flight.vehicle.plant.record.tobytes() == plain.vehicle.plant.record.tobytes()
        flight.begin()
        flight.wire.impair(Impairment(loss=loss), Impairment(loss=loss, jitter_s=0.1 * loss), 1e9)
        flight.link.fly(Velocity(2.0, None), 4.0)
        flight.link.wait(8.0)
        records.append(flight.vehicle.plant.record.tobytes())
        for way in flight.wire.counts:
            assert way.lost / way.taken == pytest.approx(loss, abs=0.08)
    assert records[1] == records[2] != records[0]


def test_a_vehicle_that_loses_its_setpoints_descends_by_its_failsafe() -> None:
    flight = aloft()
    flight.begin()
    flight.wire.impair(Impairment(loss=1.0), PERFECT, 1e9)
    flight.link.wait(2.0)
    assert flight.link.state.mode != "OFFBOARD"
    flight.link.wait(6.0)  # the failsafe is not detected as a takeover
    assert flight.places[-1][2] > flight.places[0][2] + 1.0


def test_hover_thrust_adapts_to_a_payload_and_the_height_is_held() -> None:
    empty, laden = aloft(), aloft(payload_kg=0.5)
    learnt = []
    for flight in (empty, laden):
        flight.begin()
        flight.link.wait(8.0)
        learnt.append(float(flight.vehicle.core.state["hover_thrust"]))
        heights = np.array(flight.places)[:, 2]
        assert np.ptp(heights) < 0.3
    assert learnt[1] / learnt[0] == pytest.approx(2.5 / 2.0, rel=0.05)  # its battery sags more, too
    assert laden.vehicle.core.params["hover_thrust"] == empty.vehicle.core.params["hover_thrust"]  # not tuned


def test_wind_starts_at_the_begin_and_the_vehicle_leans_against_it_by_its_drag() -> None:
    north = 7.0
    flight = aloft(disturbances=VehicleFaults(wind_ned=(north, 0.0, 0.0)))
    assert abs(quat_to_euler(tuple(flight.vehicle.plant.truth["attitude"].tolist()))[1]) < math.radians(1.5)
    flight.begin()
    flight.link.wait(12.0)
    speeds = flight.vehicle.plant.state["rotor_speed"][:4]
    drag = (X500.drag_linear_frd[0] + X500.drag_quadratic_frd[0] * north) * north
    drag += X500.curve.drag_coefficient * float(np.sum(speeds)) * north
    pitch = np.mean([euler[1] for euler in flight.attitudes[-400:]])
    assert pitch == pytest.approx(math.atan2(drag, X500.mass_kg * GRAVITY), rel=0.05)  # wind from behind: nose up
    moved = np.array(flight.places)[:, :2] - flight.places[0][:2]
    assert 0.1 < moved[:, 0].max() < 3.0  # it drifts off and comes back
    assert np.linalg.norm(moved[-1]) < 0.5


def test_the_estimate_lags_by_the_distance_flown_during_the_gps_delay() -> None:
    def behind(delay_s: float) -> float:
        flight = aloft(disturbances=VehicleFaults(gps_delay_s=delay_s))
        flight.begin()
        flight.link.fly(Velocity(2.0, None), 30.0)
        flight.link.wait(12.0)
        return float(-np.mean(np.array(flight.errors)[-200:, 0]))

    assert behind(0.3) - behind(0.0) == pytest.approx(2.0 * 0.3, rel=0.3)


@pytest.mark.parametrize(("hz", "expected_hz"), [(None, 20.0), (4.0, 4.0), (15.0, 15.0), (40.0, 40.0)])
def test_setpoints_are_sent_at_the_requested_rate(hz: float | None, expected_hz: float) -> None:
    flight = aloft()
    sent: list[float] = []
    flight.begin()
    flight.link.stream_at(hz)
    flight.link.wait(2.0)
    flight.link.on_setpoint = lambda setpoint: sent.append(flight.lockstep.now_s())
    flight.link.wait(5.0)
    assert len(sent) / 5.0 == pytest.approx(expected_hz, rel=0.06)
    assert np.ptp(np.array(flight.places), axis=0).max() < 0.3
    assert flight.link.state.mode == "OFFBOARD"
