"""Writes one flight as a Rerun recording with its blueprint (viewer layout). Needs the extra `rerun`.

The timeline `episode` begins with the episode. The entity `world` has ENU axes. `world/drone_0` is the body (FLU) at
its estimated pose, and `world/judge/drone_0` is the body at its true pose. `…/camera` has right-down-forward axes.
`map` has geodetic positions.
"""

from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from dronecats.report.export.conventions import (
    JUDGE,
    about,
    camera_body,
    drone_name,
    enu,
    flu,
    judged,
    lon_lat_alt,
    microseconds,
    named_tracks,
    optical_in_flu,
    read_picture,
    reply_text,
    xyzw_flu_to_enu,
)
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.tracks import DroneTracks, FlightTrack
from foundation.protocol import POINT_SPAN
from foundation.run_folder.rows import drone_label

TIMELINE = "episode"
ESTIMATE_COLOR, JUDGE_COLOR = (61, 138, 208), (255, 159, 43)
TARGET_M = 0.4  # m, radius of the ball that marks a target


def write(flight: RecordedFlight, path: Path) -> int:
    """Write a flight; return the number of poses, pictures and texts. Raises UsageError for a damaged picture."""
    name = f"{about(flight)['run']}/{flight.id}"
    recording = rr.RecordingStream("dronecats", recording_id=name, send_properties=False)
    recording.save(str(path), default_blueprint=blueprint(flight))
    rr.set_log_time_enabled(False, recording)
    rr.set_log_tick_enabled(False, recording)
    recording.send_recording_name(name)
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.send_property("flight", rr.AnyValues(**about(flight)))
    recording.send_property(JUDGE, rr.AnyValues(**{k.partition("/")[2]: v for k, v in judged(flight).items()}))
    count = 0
    for drone in flight.drone_tracks:
        count += sum(_track(recording, flight, name, track) for name, track in named_tracks(drone))
        count += _pictures(recording, flight, drone)
    count += _words(recording, flight)
    _target(recording, flight)
    recording.flush()
    recording.disconnect()
    return count


def blueprint(flight: RecordedFlight) -> rrb.Blueprint:
    """Return the blueprint: pictures, map, log, and the scene once without and once with the judge's entities."""
    pictures = [
        rrb.Spatial2DView(origin=f"world/{camera_body(drone)}/camera/image", name=drone_name(drone.number))
        for drone in flight.drone_tracks
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(
                rrb.Spatial3DView(origin="world", contents=["+ /world/**", f"- /world/{JUDGE}/**"], name="flight"),
                rrb.Spatial3DView(origin="world", name=f"with the {JUDGE}"),
                rrb.MapView(origin="map", contents=["+ /map/**", f"- /map/{JUDGE}/**"], name="map"),
            ),
            rrb.Vertical(
                rrb.Grid(*pictures),
                rrb.Tabs(
                    rrb.TextLogView(origin="log", name="log"),
                    rrb.TextLogView(origin=f"{JUDGE}/log", name=f"{JUDGE}'s log"),
                ),
                row_shares=[2, 1],
            ),
        ),
        collapse_panels=True,
    )


def _track(recording: rr.RecordingStream, flight: RecordedFlight, name: str, track: FlightTrack) -> int:
    color = JUDGE_COLOR if name.startswith(JUDGE) else ESTIMATE_COLOR
    times = rr.TimeColumn(TIMELINE, duration=_durations(track))
    turned = np.array([xyzw_flu_to_enu((float(w), float(x), float(y), float(z))) for w, x, y, z in track.attitude])
    places = enu(track.position_ned)
    moved = rr.Transform3D.columns(translation=places, quaternion=turned)
    recording.send_columns(f"world/{name}", [times], moved)
    recording.log(f"world/{name}", rr.TransformAxes3D(0.5), static=True)
    above = f"world/{name.replace('drone', 'trail')}"  # not a child of the body, so it does not move with the body
    recording.log(above, rr.LineStrips3D([places], colors=[color]), static=True)
    if flight.origin is not None:
        on_earth = [lon_lat_alt(flight.origin, (float(n), float(e), float(d))) for n, e, d in track.position_ned]
        lat_lon = [(latitude, longitude) for longitude, latitude, _ in on_earth]
        geo_points = rr.GeoPoints.columns(positions=lat_lon)
        recording.send_columns(f"map/{name}", [times], geo_points)
    return len(track)


def _durations(track: FlightTrack) -> Any:
    return np.array([microseconds(float(t)) for t in track.t_s], "timedelta64[us]")


def _pictures(recording: rr.RecordingStream, flight: RecordedFlight, drone: DroneTracks) -> int:
    """Log a drone's pictures as the pilot received them, with the chosen points."""
    camera = f"world/{camera_body(drone)}/camera"
    frames = [frame for frame in flight.frames if frame.drone == drone.number]
    for t_s, model in flight.camera_changes(drone.number):
        _at(recording, t_s)
        recording.log(camera, rr.Transform3D(translation=flu(model.offset_frd), quaternion=optical_in_flu(model)))
    sizes = {}
    for frame in frames:
        height, width = read_picture(frame.jpeg).shape[:2]
        sizes[frame.frame_id] = (width, height)
        _at(recording, frame.t_s)
        jpeg = frame.jpeg.read_bytes()
        recording.log(f"{camera}/image", rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))
        focal = flight.camera.focal_px * width / flight.camera.width
        recording.log(f"{camera}/image", rr.Pinhole(focal_length=focal, width=width, height=height))
    for step in flight.steps:
        if step.decision.drone == drone.number and step.decision.frame_id in sizes:
            width, height = sizes[step.decision.frame_id]
            _at(recording, step.decision.t_frame)
            chosen = [(step.go.x / POINT_SPAN * width, step.go.y / POINT_SPAN * height)] if step.go else []
            points = rr.Points2D(
                chosen, radii=8.0, colors=[ESTIMATE_COLOR], labels=[f"step {step.decision.step}"] * len(chosen)
            )
            recording.log(f"{camera}/image/chosen", points)
    return len(frames)


def _words(recording: rr.RecordingStream, flight: RecordedFlight) -> int:
    """Log the instruction and every reply, and the declarations to the judge's log; return the number of texts."""
    _at(recording, 0.0)
    recording.log("log", rr.TextLog(f"instruction: {flight.instruction}", level="INFO"))
    for step in flight.steps:
        decision = step.decision
        _at(recording, decision.t_decided)
        words = f"{drone_label(decision.drone)}, step {decision.step}: {reply_text(decision)}"
        recording.log("log", rr.TextLog(words, level="WARN" if decision.error else "INFO"))
    for declaration in flight.all_declarations:
        _at(recording, declaration.t)
        words = f"declaration of step {declaration.step} at {declaration.distance_m} m, in view: {declaration.visible}"
        recording.log(f"{JUDGE}/log", rr.TextLog(words, level="INFO"))
    return 1 + len(flight.steps) + len(flight.all_declarations)


def _target(recording: rr.RecordingStream, flight: RecordedFlight) -> None:
    track = flight.target_track
    if track is not None:
        times = rr.TimeColumn(TIMELINE, duration=_durations(track))
        balls = rr.Points3D.columns(positions=enu(track.position_ned), radii=[TARGET_M] * len(track))
        recording.send_columns(f"world/{JUDGE}/target", [times], balls)


def _at(recording: rr.RecordingStream, t_s: float) -> None:
    recording.set_time(TIMELINE, duration=np.timedelta64(microseconds(t_s), "us"))
