"""Checks that a fleet's pictures show the drones at their true places, with an independent pinhole model."""

from pathlib import Path
from typing import Any

import numpy as np
from pymavlink import mavutil

from dronecats.flight.sitl.camera import GRAIN
from dronecats.flight.sitl.episode_world import load_world, origin
from episodes.camera.renderer import Renderer
from episodes.maps.assets.multirotor import X500
from foundation.camera import CameraModel, camera_pose
from foundation.frames import geodetic_to_ned
from tests import pictures

CAMERA = CameraModel()
SIZE = (640, 360)  # px, of the stored pictures
POINTS = np.array([*X500.touching, *X500.hubs, CAMERA.offset_frd])  # points that enclose a drone
DIFFERS = 40  # of 255 levels: more than the JPEG error at an edge
NEAR_M = 3.0  # m; no obstacle is between drones this near to each other


def true_poses(folder: Path, world):
    """Return drone → time in µs → (place NED, attitude, matrix body → NED), from the truth bus in the tlog."""
    log = mavutil.mavlink_connection(str(folder / "flight.tlog"), dialect="development")
    poses: dict[int, Any] = {}
    while message := log.recv_match(type="HIL_STATE_QUATERNION"):
        w, x, y, z = message.attitude_quaternion
        turned = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        place = geodetic_to_ned(*origin(world), message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)
        of_drone = poses.setdefault(message.get_srcSystem() - 1, {})
        of_drone[message.time_usec] = (place, (w, x, y, z), turned)
    return poses


def enclosing(place, turned):
    """Return points (n, 3) in NED that enclose a drone."""
    return np.array(place) + POINTS @ turned.T


def shadow_of(points, world):
    """Return the shadow of points (n, 3) in the sun, on the ground below their middle."""
    toward = np.array(world.scene.sun.toward_ned)
    ground = world.ground_down(*points.mean(axis=0)[:2])
    return points - toward * ((points[:, 2] - ground) / toward[2])[:, None]


def box_around(points, eye, axes):
    """Return the box (left, top, right, bottom; px) around points, and their least depth. None beside the lens."""
    local = (points - eye) @ axes
    if (local[:, 0] < 0.2).any():
        return None
    pixels = np.array(SIZE) / 2 + SIZE[0] / 2 * local[:, 1:] / local[:, :1]
    (left, top), (right, bottom) = pixels.min(axis=0), pixels.max(axis=0)
    return (left, top, right, bottom), float(local[:, 0].min())


def check(folder: Path, truth) -> tuple[int, int]:
    """Compare every picture of a flight with one without drones; return (drones seen, empty pictures).

    Raises AssertionError if a near drone is not in its true box, or if the pictures differ outside the boxes of the
    drones and of their shadows.
    """
    world = load_world(str(folder / "episode.json"))
    poses, bare = true_poses(folder, world), Renderer(world.scene, CameraModel(*SIZE), grain=GRAIN)
    t0_us = next(line["t0_us"] for line in truth if line["kind"] == "begin")
    frames = {line["frame_id"]: line for line in truth if line["kind"] == "frame"}
    seen = empty = 0
    for file in sorted((folder / "frames").iterdir()):
        frame = frames[int(file.stem.split("_")[0])]
        time_us, mine = t0_us + round(frame["t"] * 1e6), frame["drone"]
        place, attitude, axes = poses[mine][time_us]
        without = bare.picture(camera_pose(place, attitude, CAMERA), world.moved(frame["t"]))
        differs = np.abs(pictures.read(file)[..., ::-1].astype(int) - without).max(axis=2) > DIFFERS
        allowed, eye = np.zeros_like(differs), np.array(place) + axes @ CAMERA.offset_frd
        for other in poses.keys() - {mine}:
            at = min(poses[other], key=lambda time: abs(time - time_us))
            points = enclosing(poses[other][at][0], poses[other][at][2])
            for of_drone, shape in ((True, points), (False, shadow_of(points, world))):
                framed = box_around(shape, eye, axes)
                if framed is None:
                    continue
                (left, top, right, bottom), depth = framed
                rows = slice(max(int(top) - 3, 0), max(int(bottom) + 4, 0))
                columns = slice(max(int(left) - 3, 0), max(int(right) + 4, 0))
                allowed[rows, columns] = True
                inside = left > 0 and top > 0 and right < SIZE[0] and bottom < SIZE[1]
                if of_drone and depth < NEAR_M and inside:
                    assert differs[rows, columns].mean() > 0.05, f"drone {other} is not in {file.name}"
                    seen += 1
        assert (differs & ~allowed).mean() < 0.001, f"{file.name} shows what is not there"
        empty += not allowed.any()
    bare.close()
    return seen, empty
