"""Flies an episode with a connected vehicle. `ConnectedFlight` has no true poses, so its flights are not scored."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.agent.cockpit import AgentFactory
from dronecats.flight.intent import draw as draw_intent
from dronecats.flight.run.ascent import StartOffset
from dronecats.flight.run.episode import EpisodeEnd, Ready
from dronecats.flight.run.pilot import OpenPilot, opened
from dronecats.flight.run.setup import FlightSetup, Instruments, Notify
from dronecats.flight.spec.flight import Flight
from dronecats.flight.spec.flight_spec import Connected
from dronecats.flight.stages.stage import ConnectedStage
from dronecats.pilots import roster
from foundation.camera import CameraModel
from foundation.errors import CameraError, DronecatsError, UsageError
from foundation.run_folder import layout
from foundation.run_folder.folder import write_json
from foundation.run_folder.layout import onboard_log_name
from foundation.signing import load_key
from hil.cameras.address import shown
from hil.cameras.open import FRAMES_S, PatientCamera, RealCamera, open_camera
from hil.link.envelope import Limits
from hil.link.flight_logs import log_store
from hil.link.link import Link
from hil.link.transport import Reopening, connect

LATER = "Fetch it later with: dronecats flightlog fetch --connect URL"


def fetch_onboard_log(url: str, link: Link, folder: Path, notify: Callable[[str], None]) -> None:
    """Fetch the newest log of a vehicle whose link is closed; print the reason if that fails."""
    if link.state.armed:
        notify(f"the autopilot's log was not fetched, because the vehicle is still armed. {LATER}")
        return
    try:
        with log_store(url) as store:
            logs = [log for log in store.entries() if log.size_bytes]
            if not logs:
                notify("the autopilot's log was not fetched: there is none on board")
                return
            notify(f"fetching the autopilot's log ({logs[-1].size_bytes:,} bytes) …")
            store.fetch(logs[-1], folder).rename(folder / onboard_log_name())
    except DronecatsError as fault:
        notify(f"the autopilot's log was not fetched: {fault}. {LATER}")


EPISODE = "connected"
HEIGHT_M = 2.5  # m, height of the start pose above the take-off place: the default of PX4's MIS_TAKEOFF_ALT
# wall seconds without telemetry (for example, an unplugged cable) after which the flight ends. The vehicle's own
# failsafe takes over much earlier
SILENCE_S = 6.0


class VehicleFlight(FlightSetup):
    camera_model = CameraModel()

    def __init__(self, flight: Flight, vehicle: Connected, link: Link, episode: str, camera: dict[str, Any]) -> None:
        """`link` is open. The flight closes it."""
        super().__init__(flight, episode, camera)
        self.vehicle, self.link, self.authority = vehicle, link, vehicle.authority

    def facts(self) -> dict[str, Any]:
        return {**super().facts(), "firmware": str(self.link.firmware) if self.link.firmware else None}

    def finish(self, folder: Path, ending: EpisodeEnd, notify: Notify) -> None:
        if self.flight.spec.keep_ulog:
            fetch_onboard_log(self.vehicle.url, self.link, folder, notify)
        if self.authority.dry:
            notify(f"{draw_intent(folder, self.camera_model)} decisions are drawn in {folder / layout.INTENT}")


class ConnectedFlight(VehicleFlight):
    """A flight in the real world, or in a simulation that does not send the vehicle's true poses."""

    def __init__(self, flight: Flight, vehicle: Connected, instruments: Instruments) -> None:
        """Open the vehicle's link and camera. Raises UsageError, LinkError."""
        pilot = flight.spec.pilot
        if roster.needs_truth(pilot):
            raise UsageError(
                f"the pilot {pilot} needs the truth, which only --sitl or --truth gives."
                " Choose --pilot vision or --model"
            )
        self._instruments = instruments
        with ExitStack() as undo:
            link = open_link(vehicle, flight.spec.envelope)
            undo.callback(link.close)
            self._camera = _camera(vehicle, link, undo)
            model = self.camera_model = self._camera.model
            if flight.spec.replay is None:
                roster.check_camera(pilot, model)
            undo.pop_all()  # link and camera stay open
        described = {"width": model.width, "height": model.height, "hfov_deg": round(model.hfov_deg, 3)}
        super().__init__(flight, vehicle, link, EPISODE, {**described, "url": shown(vehicle.camera or "")})

    def write_record(self, folder: Path) -> None:
        write_json(folder / layout.EPISODE, {"id": EPISODE, "instruction": self.flight.instruction})

    @contextmanager
    def ready(self, folder: Path, notify: Notify) -> Iterator[Ready]:
        camera = PatientCamera(self._camera, FRAMES_S, lambda fault: notify(f"      holding: {fault}"))
        stage = ConnectedStage(self.link, camera, folder)
        try:
            self._instruments.watch(self.link, camera, folder.parent)
            with opened(self.flight, stage, folder) as pilot:
                watched = replace(pilot, model=self._instruments.model(pilot.model))
                yield Ready(stage=stage, starts=[StartOffset((0.0, 0.0, -HEIGHT_M), None)], pilot=watched)
        finally:
            stage.close()

    def agent(self, pilot: OpenPilot) -> AgentFactory:
        return self._instruments.agent(super().agent(pilot))


def open_link(vehicle: Connected, limits: Limits | None) -> Link:
    """Return the link to a connected vehicle. It reopens if the cable was unplugged. Raises UsageError, LinkError."""
    key = load_key(Path(vehicle.sign)) if vehicle.sign else b""
    wire = Reopening(lambda: connect(vehicle.url))
    return Link(wire, silence_s=SILENCE_S, key=key, limits=limits, dry=vehicle.authority.dry)


def _camera(vehicle: Connected, link: Link, undo: ExitStack) -> RealCamera:
    """Open the camera before take-off and wait for its first frame. Raises UsageError if no frame comes."""
    max_age_s = link.limits.frame_s if link.limits else Limits().frame_s
    try:
        camera = open_camera(vehicle.camera or "", lambda: link.time_us, vehicle.calibration, max_age_s=max_age_s)
        undo.callback(camera.close)
        camera.newest()
    except CameraError as error:
        raise UsageError(str(error)) from None
    return camera
