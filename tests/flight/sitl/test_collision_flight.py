"""A flight into the target of a shipped episode: the car stops the drone, and the bus reports the hit."""

import math
from typing import Any

import pytest

from autopilot.records import FREE, NAN, CascadeSetpoint
from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.episode_world import load_world
from dronecats.flight.sitl.simulation import SimulatedVehicle, build
from episodes.world.world import World
from foundation.frames import rotate
from foundation.mavlink import Parser
from vehicles.solids import in_triangle

CAMERA = (0.5, 0.0, 0.1)


class Flight:
    """An X500 over the episode's map, flown through its commander."""

    def __init__(self, episode: str, beside: float) -> None:
        """Put it on the ground `beside` metres from the target's side, take off to 1.2 m and face the target."""
        self.world: World = load_world(episode)
        self.simulation = build(SimulatedVehicle, self.world, SimulatorConfig(episode=episode, seed=3))
        self.vehicle = self.simulation.vehicles[0]
        self._tap, self._parser = self.simulation.bus.tap(), Parser()
        self.texts: list[Any] = []
        commander = self.commander = self.vehicle.autopilot.commander
        place, yaw = self.world.target_upright(0.0)
        state, down = self.vehicle.plant.state, self.vehicle.plant.params["contact_position"][:, 2].max()
        north, east = place[0] - beside * math.sin(yaw), place[1] + beside * math.cos(yaw)
        state["position"] = (north, east, self.world.ground_down(north, east) - down)
        while commander.arming_failures():
            self.advance(0.5)
        self.advance(3.0)
        commander.take_off(2.5)
        commander.arm()
        self.advance(8.0)
        self.heading = math.atan2(place[1] - east, place[0] - north)
        self.stream(0.0)
        commander.set_mode("OFFBOARD")
        self.fly(0.0, 4.0)

    def stream(self, speed: float) -> None:
        offboard = self.commander.flight.offboard
        ahead = (speed * math.cos(self.heading), speed * math.sin(self.heading), NAN)
        offboard.setpoint = CascadeSetpoint(
            position_ned=(NAN, NAN, -1.2), velocity_ned=ahead, acceleration_ned=FREE, yaw=self.heading
        )
        offboard.time_us = self.vehicle.autopilot.state.time_us

    def fly(self, speed: float, seconds: float) -> float:
        """Fly towards the target. Return the least distance (m) of the lens to any surface."""
        nearest = math.inf
        for _ in range(round(seconds / 0.05)):
            self.stream(speed)
            self.advance(0.05)
            state = self.vehicle.plant.state
            arm = rotate(tuple(state["attitude"]), CAMERA)
            lens = tuple(float(p + a) for p, a in zip(state["position"], arm, strict=True))
            plant = self.vehicle.plant
            for t in plant.near["candidate"][: plant.near["candidates"]]:
                nearest = min(nearest, math.dist(in_triangle(plant.obstacles.corners, t, *lens)[:3], lens))
        return nearest

    def advance(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.simulation.advance()
            self.texts += [m.text for m in self._parser.feed(self._tap.take()) if m.get_type() == "STATUSTEXT"]


def test_a_drone_that_flies_into_the_target_stops_at_its_surface() -> None:
    flight = Flight("residential-approaching-01", 4.0)
    assert not flight.texts
    nearest = flight.fly(1.2, 5.0)
    state = flight.vehicle.plant.state
    assert state["hits"] >= 1
    assert any("target" in text for text in flight.texts)
    assert 0.0495 < nearest < 0.3  # outside, by more than the renderer's near plane
    assert state["position"][1] > 2.7 + 1.0  # still beside the car


def test_the_collision_box_of_a_moving_target_follows_its_position() -> None:
    config = SimulatorConfig(episode="residential-tracking-01", seed=3)
    world = load_world(config.episode)
    simulation = build(SimulatedVehicle, world, config)
    solids = simulation.vehicles[0].plant.solids
    simulation.advance()
    assert solids["box"] == 0
    simulation.begin(simulation.time_us)
    begun = simulation.time_us
    for _ in range(12):
        for _ in range(50):
            simulation.advance()
        t_s = (simulation.time_us - begun) / 1e6
        since = (simulation.time_us - solids["box_time_us"]) / 1e6
        there = solids["box_centre"] + solids["box_velocity"] * since
        assert there == pytest.approx(world.target_centre(t_s), abs=0.05)
