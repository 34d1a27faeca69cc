"""Draws pictures of maps and episodes: plans, views, first frames, and one place under all camera options.

The same arguments give the same bytes.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from episodes import maps
from episodes.camera.optics.camera import OpticalRenderer, VehicleMotion
from episodes.camera.optics.options import Exposure, Haze, LensModel, Optics, Rain, Sensor
from episodes.camera.renderer.renderer import Renderer
from episodes.maps.scene import Picture, Scene
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord
from episodes.world.world import World
from foundation.camera import CameraModel, CameraPose, camera_pose
from foundation.conditions import SceneConditions
from foundation.errors import UsageError
from foundation.files import file_errors_as
from foundation.frames import quat_from_euler

Rect = tuple[int, int, int, int]  # px: left, top, right, bottom

# Plans
UNNAMED = ("ground", "wood", "shrub", "bush", "bollard", "fence", "hedge")  # kinds without a label
SIDE_PX = 1800
HFOV_DEG = 12.0  # narrow field of view, from high above, so that tall things lean outwards by less than their width
MARGIN_M = 6.0
PALE = 0.42  # share of white mixed into the picture, so that the names stand out
PLAN_QUALITY = 72

# Views
ABOVE_SPAWN_M = 12.0  # height of the camera above the spawn point, for a map that is not in maps.VANTAGE
CENTRED = CameraModel(1280, 720, 90.0, (0.0, 0.0, 0.0))  # no offset: the optical centre is at the given pose
LARGEST_BYTES = 250_000
QUALITIES = range(90, 40, -5)  # of JPEG; the first one that needs at most LARGEST_BYTES is used

SUFFIXES = (".png", ".jpg", ".jpeg")  # allowed suffixes of the file of a first frame

# The sheet of the options of camera, light and season
SHOWN: dict[str, Optics] = {
    "all off": Optics(),
    "lens: k1 -0.25, vignetting 1": Optics(lens=LensModel(k1=-0.25, k2=0.05, vignetting=1.0)),
    "sensor: 300 e, read 12 e": Optics(sensor=Sensor(300.0, 12.0)),
    "exposure: 50 ms at 1 m/s, 60 deg/s": Optics(exposure=Exposure(0.05, 12)),
    "haze: 0.02 per m": Optics(haze=Haze(0.02)),
    "rain: 40 mm/h": Optics(rain=Rain(40.0)),
    "haze, rain, lens, noise": Optics(
        LensModel(k1=-0.2, k2=0.03, vignetting=0.7),
        Sensor(2000.0, 8.0),
        Exposure(0.008, 2),
        haze=Haze(0.01),
        rain=Rain(20.0),
    ),
}
LIGHTS: dict[str, SceneConditions] = {
    "--sun 280,8": SceneConditions(sun_azimuth_deg=280.0, sun_elevation_deg=8.0),
    "--sky overcast": SceneConditions(sky="overcast"),
    "--sky dusk": SceneConditions(sky="dusk"),
    "--season autumn": SceneConditions(season="autumn"),
}
TILE_PX, COLUMNS, LABEL_PX, SHEET_QUALITY = (480, 270), 2, 24, 82


def write_map_plan(name: str, out: Path) -> None:
    """Write a plan of a map as JPEG, north up, with the names of its instances, except those of kinds in UNNAMED.

    A record uses such a name for a native target (a target that belongs to the map).

    Raises UsageError for an unknown map, or a file that cannot be written.
    """
    scene = maps.build(name)
    named = [i for i in scene.instances if i.kind not in UNNAMED]
    places = np.array([i.position_ned[:2] for i in named] or [scene.spawn_ned[:2]])
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    half = float(np.ptp(places, axis=0).max()) / 2 + MARGIN_M
    picture = from_above(scene, float(middle[0]), float(middle[1]), half)
    picture = np.asarray(picture * (1.0 - PALE) + 255.0 * PALE, np.uint8)
    taken: list[Rect] = []
    for instance in named:
        # west is left, and north is up
        x = SIDE_PX / 2 + (instance.position_ned[1] - middle[1]) / half * SIDE_PX / 2
        y = SIDE_PX / 2 - (instance.position_ned[0] - middle[0]) / half * SIDE_PX / 2
        _label(picture, instance.name, round(x), round(y), taken)
    write_picture(jpeg(picture, PLAN_QUALITY, optimize=False), out)


def from_above(scene: Scene, north: float, east: float, half: float, side_px: int = SIDE_PX) -> Picture:
    """Return the picture (side_px, side_px, 3) of the ground around a place, north up, `half` metres to each side."""
    height = half / math.tan(math.radians(HFOV_DEG / 2))
    eye = (north, east, scene.terrain.at(north, east) - height)
    pose = CameraPose(eye, quat_from_euler(0.0, -math.pi / 2, 0.0))
    return rendered(scene, CameraModel(side_px, side_px, HFOV_DEG, (0.0, 0.0, 0.0)), pose)


def _label(picture: Picture, text: str, x: int, y: int, taken: list[Rect]) -> None:
    """Draw a dot, and write `text` beside it, if possible where no earlier text is."""
    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.36
    (wide, tall), _ = cv2.getTextSize(text, font, size, 1)
    around = ((5, 4), (-wide - 5, 4), (-wide // 2, -6), (-wide // 2, tall + 6), (5, -8), (5, tall + 8), (-wide - 5, -8))
    rects = [(x + dx, y + dy - tall, x + dx + wide, y + dy) for dx, dy in around]
    free = [r for r in rects if r[0] > 0 and r[2] < SIDE_PX and not any(_meet(r, label) for label in taken)]
    left, top, right, bottom = (free or rects)[0]
    taken.append((left, top, right, bottom))
    cv2.circle(picture, (x, y), 2, (170, 20, 20), -1, cv2.LINE_AA)
    cv2.putText(picture, text, (left, bottom), font, size, (255, 255, 255), 3, cv2.LINE_AA)
    cv2.putText(picture, text, (left, bottom), font, size, (20, 20, 24), 1, cv2.LINE_AA)


def _meet(a: Rect, b: Rect) -> bool:
    return a[0] < b[2] + 2 and b[0] < a[2] + 2 and a[1] < b[3] + 2 and b[1] < a[3] + 2


def write_map_view(name: str, out: Path) -> None:
    """Write a JPEG that shows a map from its vantage point. It has at most LARGEST_BYTES, or the lowest of QUALITIES.

    Raises UsageError for an unknown map, or a file that cannot be written.
    """
    scene = maps.build(name)
    n0, e0, _ = scene.spawn_ned
    default = (n0, e0, ABOVE_SPAWN_M, math.degrees(scene.spawn_yaw), -15.0)
    north, east, height, heading, pitch = maps.VANTAGE.get(name, default)
    eye = (north, east, scene.terrain.at(north, east) - height)
    attitude = quat_from_euler(0.0, math.radians(pitch), math.radians(heading))
    view = rendered(scene, CENTRED, CameraPose(eye, attitude))
    for quality in QUALITIES:
        data = jpeg(view, quality)
        if len(data) <= LARGEST_BYTES:
            break
    write_picture(data, out)


def first_frame(record: EpisodeRecord, camera: CameraModel) -> Picture:
    """Return the camera's picture (H, W, 3) at t = 0. For a fleet, return the pictures of all drones in two columns."""
    world = World(record)
    renderer = Renderer(world.filmed, camera)
    views = []
    for drone, start in enumerate(world.fleet.starts):
        moved = world.moved(0.0, world.fleet.other_starts(drone))
        views.append(renderer.picture(camera_pose(start.position_ned, start.attitude, camera), moved))
    renderer.close()
    return in_rows(views, min(len(views), 2))


def in_rows(pictures: Sequence[Picture], columns: int) -> Picture:
    """Return pictures of one size in a grid with this many columns. Empty cells are light grey."""
    spare = -len(pictures) % columns
    filled = [*pictures, *[np.full_like(pictures[0], 246)] * spare]
    return np.concatenate([np.concatenate(filled[k : k + columns], axis=1) for k in range(0, len(filled), columns)])


def write_first_frame(record: EpisodeRecord, file: Path) -> None:
    """Write the first frame, 1280 px wide; for a fleet, 640 px per drone. Raises UsageError if that fails."""
    if file.suffix.lower() not in SUFFIXES:
        raise UsageError(f"--picture must be a file that ends in {', '.join(SUFFIXES)}, got '{file.name[:60]}'.")
    camera = CameraModel() if len(record.starts) == 1 else CameraModel(640, 360)
    done, data = cv2.imencode(file.suffix.lower(), first_frame(record, camera)[..., ::-1])
    if not done:
        raise UsageError(f"the picture '{file}' cannot be encoded.")
    write_picture(data.tobytes(), file)


def write_optics_sheet(file: Path) -> None:
    """Write one place under every option of camera, light and season as JPEG. Raises UsageError if that fails."""
    record = catalogue.load(catalogue.DEFAULT)
    world = World(record)
    tiles = [_optics_tile(name, optics, world) for name, optics in SHOWN.items()]
    tiles += [_optics_tile(name, Optics(), World(record, conditions=light)) for name, light in LIGHTS.items()]
    write_picture(jpeg(in_rows(tiles, COLUMNS), SHEET_QUALITY), file)


def _optics_tile(name: str, optics: Optics, world: World) -> Picture:
    """Return one labelled picture from the episode's start."""
    start = world.fleet.starts[0]
    motion = VehicleMotion(
        time_s=0.0,
        position_ned=start.position_ned,
        velocity_ned=(1.0, 0.0, 0.0),
        attitude=start.attitude,
        rates_frd=(0.0, 0.0, math.radians(60.0) if name.startswith("exposure") else 0.0),
    )
    renderer = OpticalRenderer(world.scene, CameraModel(), optics)
    picture = cv2.resize(renderer.picture(motion, world.moved, (1,)), TILE_PX, interpolation=cv2.INTER_AREA)
    renderer.close()
    label = np.full((LABEL_PX, TILE_PX[0], 3), 246, np.uint8)
    cv2.putText(label, name, (6, LABEL_PX - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (36, 38, 42), 1, cv2.LINE_AA)
    return np.concatenate((label, picture))


def rendered(scene: Scene, camera: CameraModel, pose: CameraPose, **options: int) -> Picture:
    """Return one picture of a scene; `options` are those of `Renderer`."""
    renderer = Renderer(scene, camera, **options)
    try:
        return renderer.picture(pose)
    finally:
        renderer.close()


def jpeg(picture: Picture, quality: int, optimize: bool = True) -> bytes:
    settings = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, int(optimize)]
    return cv2.imencode(".jpg", picture[..., ::-1], settings)[1].tobytes()


def write_picture(data: bytes, file: Path) -> None:
    """Write an encoded picture, and create its folder if it is missing. Raises UsageError if that fails."""
    with file_errors_as(UsageError, f"the picture '{file}' cannot be written", "."):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)
