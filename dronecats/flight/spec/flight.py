"""Resolves and checks all names in the specification of a flight, before anything is started."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.agent.models.ledger import Budget, Ledger
from dronecats.agent.models.model import Model
from dronecats.agent.models.replay import ReplyCache
from dronecats.agent.models.wire_formats import open_model
from dronecats.agent.prompt import Prompt
from dronecats.flight.spec.flight_spec import ON_CLUSTER, FlightSpec
from dronecats.pilots import roster
from episodes import maps
from episodes.camera.optics.file import optics_of
from episodes.camera.optics.options import Optics
from episodes.records import catalogue
from episodes.records import record as records
from episodes.records.record import VERSION, EpisodeRecord, StartPose, TargetRecord
from foundation import extras
from foundation.camera import CameraModel, camera_on
from foundation.errors import UsageError
from vehicles import airframe as airframes
from vehicles.airframe import with_payload

FREE_HEIGHT_M = 2.5  # m above the map's spawn, start height of a flight without an episode: PX4's MIS_TAKEOFF_ALT
_CAMERA = CameraModel()
DEPTH = "16-bit PNG, mm along the optical axis, 0 beyond 65.535 m"
CAMERA = {"width": _CAMERA.width, "height": _CAMERA.height, "hfov_deg": _CAMERA.hfov_deg}


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight's specification, and everything that it names, looked up and checked."""

    spec: FlightSpec
    record: EpisodeRecord | None  # None: a connected vehicle without a world
    prompt: Prompt
    optics: Optics | None
    outside: Model | None = None  # gives the replies if another evaluation harness runs the flight (`spec.outside`)

    @property
    def instruction(self) -> str:
        return self.record.instruction if self.record else self.spec.instruction or ""

    @property
    def scored(self) -> bool:
        """Whether the vehicle's true poses are known, as a verdict requires."""
        return not self.spec.connected or self.spec.connected.truth is not None

    @property
    def seed(self) -> tuple[int, ...]:
        """The seed of all random draws of the agent: the record's seed and the spec's seed."""
        return (self.record.seed if self.record else 0, self.spec.seed)

    @property
    def camera_model(self) -> CameraModel:
        """The simulated vehicle's camera on its mount; for a connected vehicle, the benchmark's camera."""
        simulated = self.spec.simulated
        return camera_on(airframes.load(simulated.airframe).camera) if simulated else _CAMERA

    @property
    def camera(self) -> dict[str, Any] | None:
        """The camera for run.json: geometry, and optics and depth if the camera has any; None without rendering."""
        if self.spec.simulated and not self.spec.simulated.rendered:
            return None
        camera: dict[str, Any] = {**CAMERA}
        if self.camera_model.pitch_deg:
            camera["pitch_deg"] = self.camera_model.pitch_deg
        if self.camera_model.gimballed:
            camera["gimbal"] = True
        if self.optics:
            camera["optics"] = self.optics.as_dict()
        if self.spec.simulated and self.spec.simulated.camera == "depth":
            camera["depth"] = DEPTH
        return camera


def look_up(spec: FlightSpec, *, outside: Model | None = None) -> Flight:
    """Look up and check everything that a spec names. Sends no question to a model. Raises UsageError.

    `outside` gives the replies if another evaluation harness runs the flight (`spec.outside`).
    """
    if spec.outside is not None and outside is None and not spec.replay:
        raise UsageError(
            f"the replies of {spec.outside.name} can come only from {spec.outside.harness}. To repeat its"
            " recorded flight: --model replay:RUN"
        )
    if spec.simulated or (spec.connected and spec.connected.truth):
        extras.require("numba", "embreex")
    _check_accounts(spec)
    if spec.pilot and not spec.replay:
        roster.check(spec.pilot)
    if spec.command != "flat" and spec.pilot and not roster.can_serve_several_drones(spec.pilot):
        raise UsageError(
            f"--command {spec.command} asks about each drone separately, but {spec.pilot} keeps one memory for all"
            " drones. Choose vision, oracle, noisy or a model"
        )
    if spec.scripted_commander:
        roster.check_commander(spec.scripted_commander)
    simulated = spec.simulated
    if simulated:
        with_payload(airframes.load(simulated.airframe), spec.disturbances.vehicle.payload_kg)
        looks = spec.model or spec.outside or spec.commander or roster.needs_pictures(spec.pilot or "")
        if not simulated.rendered and simulated.camera:
            raise UsageError("--depth needs rendered frames. Add --rendered, or leave --depth out")
        if not (simulated.rendered or spec.replay) and looks:
            raise UsageError(
                "only the pilots oracle, noisy, blind and failing fly without rendering. All others need the frames"
            )
        if simulated.autopilot == "px4":
            airframes.require_quadrotor(airframes.load(simulated.airframe))
    record = _record(spec)
    if spec.pilot and not spec.replay:
        roster.check_installed(spec.pilot, [record.instruction if record else spec.instruction or ""])
    for model in spec.models:
        open_model(model).close()
    return Flight(
        spec=spec,
        record=record,
        prompt=Prompt.load() if spec.prompt is None else Prompt.of(spec.prompt, "the prompt"),
        optics=optics_of(simulated.optics, "optics") if simulated and simulated.optics else None,
        outside=outside,
    )


def _check_accounts(spec: FlightSpec) -> None:
    accounts = spec.accounts
    if not (models := spec.models):
        options = {"cost_limit_usd": "cost-limit", "token_limit": "token-limit", "ledger": "ledger", "cache": "cache"}
        if stray := next((name for field, name in options.items() if getattr(accounts, field) is not None), None):
            raise UsageError(
                f"--{stray} goes with --model PROVIDER/NAME, because built-in pilots cost nothing. Leave it out"
            )
        return
    for model in models:
        Budget(accounts.cost_limit_usd).check_prices(model)
    if accounts.ledger is not None and not accounts.ledger.startswith(ON_CLUSTER):
        Ledger(Path(accounts.ledger)).close()
    if accounts.cache is not None:
        ReplyCache(Path(accounts.cache)).close()


def _record(spec: FlightSpec) -> EpisodeRecord | None:
    if spec.map is not None:
        return _free_flight(spec.map, spec.instruction or "")
    if spec.episode is not None:
        record = catalogue.load(spec.episode)
    elif spec.record is not None:
        record = records.parse(json.dumps(spec.record), "the flight's record")
    else:
        return None
    if spec.drones is None:
        return record
    from episodes.records.formation import with_drones  # here, because it needs the packages of the simulator

    return with_drones(record, spec.drones)


def _free_flight(name: str, instruction: str) -> EpisodeRecord:
    """Return a record whose flight starts above the spawn of a map. Raises UsageError for an unknown map.

    A record must have a target, so the object of the map that is nearest to the spawn becomes the target. Nothing is
    added to the map.
    """
    scene = maps.build(name)
    spawn, yaw = scene.spawn_ned, scene.spawn_yaw
    landmarks = [i for i in scene.instances if i.kind != "ground" and i.solid and not i.movable]
    if not landmarks:
        raise UsageError(
            f"map '{name}' has only ground and no objects, so a pilot sees nothing. Choose a map with objects"
        )
    target = min(landmarks, key=lambda i: math.dist(i.position_ned, spawn))
    north, east, down = (a - b for a, b in zip(target.position_ned, spawn, strict=True))
    return EpisodeRecord(
        version=VERSION,
        id=f"free-{name}",
        map=name,
        map_seed=1,
        cell="approaching",
        instruction=instruction,
        target=TargetRecord(
            target.kind, position_ned=target.position_ned, yaw_deg=math.degrees(target.yaw), native=target.name
        ),
        starts=(StartPose((spawn[0], spawn[1], spawn[2] - FREE_HEIGHT_M), math.degrees(yaw)),),
        start_distance_m=math.hypot(north, east, down + FREE_HEIGHT_M),
        bearing_deg=math.degrees(math.atan2(east, north)) % 360.0,
        visible_at_start=True,
        seed=0,
    )
