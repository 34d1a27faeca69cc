"""Tracks the target with a constant-velocity Kalman filter. Its measurements are sightings.

A sighting is the place that a model's reply points at. It is accurate across the line of sight, because the pilot
points at a pixel, and inaccurate along it, because the pilot estimates the depth. The state is place and velocity in
the local frame. Between sightings x' = F x, with random acceleration.
"""

from dataclasses import dataclass

import numpy as np
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import update
from numpy.typing import NDArray

from foundation.frames import Vec3

ACROSS_M, ACROSS = 0.3, 0.02  # 1 σ across the line of sight: ACROSS_M (m) + ACROSS · distance
ALONG_M, ALONG = 0.3, 0.2  # 1 σ along the line of sight: ALONG_M (m) + ALONG · distance
SPEED_STD = 0.4  # m/s, 1 σ per axis after one sighting
ACCELERATION = 0.02  # m/s², 1 σ: people and vehicles keep their velocity for a while
GATE = 16.27  # χ² of three degrees of freedom, 99.9 %: a sighting beyond it begins a new track
FORGET_S = 60.0  # s without a sighting after which the track ends
LEAST = 3  # sightings needed for a velocity
SPEED_MAX = 1.5  # m/s, limit of estimated speeds; faster estimates come from errors in depth


@dataclass(frozen=True, slots=True)
class _Track:
    """The state of the filter after a sighting."""

    state: NDArray[np.float64]  # (6, 1): place and velocity, m, m/s
    covariance: NDArray[np.float64]  # (6, 6)
    time_s: float  # of the sighting
    sightings: int


@dataclass(frozen=True, slots=True)
class Pursued:
    """The estimated place and velocity of the target at a time."""

    place_ned: Vec3  # m, local frame
    velocity_ned: Vec3  # m/s, horizontal; an uncertain estimate is reduced towards 0


class Pursuit:
    """The track of one target. A sighting that does not belong to it begins a new track.

    A second sighting at the same time replaces the first, because it is another reply to the same picture.
    """

    def __init__(self) -> None:
        self._track: _Track | None = None
        self._before: _Track | None = None  # the track before the last sighting

    @property
    def sightings(self) -> int:
        """The number of sightings in this track."""
        return self._track.sightings if self._track else 0

    def see(self, time_s: float, lens_ned: Vec3, place_ned: Vec3) -> bool:
        """Add a place that was seen from a lens at a time (m, local frame); return False if it begins a new track."""
        noise, place = sighting_noise(lens_ned, place_ned), np.array(place_ned)
        track = self._track
        if track is not None and time_s == track.time_s:
            track = self._before
        self._before = track
        if track is not None and 0.0 <= time_s - track.time_s <= FORGET_S:
            step = transition(time_s - track.time_s)
            predicted = step @ track.state
            covariance = step @ track.covariance @ step.T + process_noise(time_s - track.time_s)
            off = place - predicted[:3, 0]
            if float(off @ np.linalg.solve(covariance[:3, :3] + noise, off)) <= GATE:
                state, covariance = update(predicted, covariance, place.reshape(3, 1), noise, np.eye(3, 6))
                self._track = _Track(state, covariance, time_s, track.sightings + 1)
                return True
        covariance = np.diag([0.0] * 3 + [SPEED_STD**2] * 3)
        covariance[:3, :3] = noise
        self._track = _Track(np.array([*place_ned, 0.0, 0.0, 0.0]).reshape(6, 1), covariance, time_s, 1)
        return False

    def at(self, time_s: float) -> Pursued | None:
        """Return the estimate at a time, which must not be before the last sighting; None if no track exists then."""
        track = self._track
        if track is None or time_s - track.time_s > FORGET_S:
            return None
        velocity = _velocity(track)
        age = max(0.0, time_s - track.time_s)
        seen = track.state[:3, 0]
        return Pursued((seen[0] + velocity[0] * age, seen[1] + velocity[1] * age, float(seen[2])), velocity)


def _velocity(track: _Track) -> Vec3:
    velocity = track.state[3:5, 0]
    speed = float(np.hypot(*velocity))
    if speed**2 == 0.0 or track.sightings < LEAST:  # the square of a tiny speed may be 0
        return (0.0, 0.0, 0.0)
    along = velocity / speed
    doubt = float(along @ track.covariance[3:5, 3:5] @ along) / speed**2
    held = max(0.0, 1.0 - doubt) * min(1.0, SPEED_MAX / speed)  # 0 if the uncertainty exceeds the velocity
    return (float(velocity[0]) * held, float(velocity[1]) * held, 0.0)


def transition(seconds: float) -> NDArray[np.float64]:
    """Return the transition matrix F over `seconds`, (6, 6)."""
    step = np.eye(6)
    step[:3, 3:] = seconds * np.eye(3)
    return step


def process_noise(seconds: float) -> NDArray[np.float64]:
    """Return the process noise Q over `seconds`, (6, 6), of a random acceleration that is constant in this time."""
    made = Q_discrete_white_noise(2, seconds, ACCELERATION**2, block_size=3, order_by_dim=False)
    return np.asarray(made, float)


def sighting_noise(lens_ned: Vec3, place_ned: Vec3) -> NDArray[np.float64]:
    """Return the noise R of a sighting, (3, 3) m²: σ∥² u uᵀ + σ⊥² (1 − u uᵀ), u: unit vector of the line of sight."""
    offset = np.array(place_ned) - np.array(lens_ned)
    distance = float(np.linalg.norm(offset))
    line = offset / distance if distance else np.array([1.0, 0.0, 0.0])
    along = np.outer(line, line)
    return (ALONG_M + ALONG * distance) ** 2 * along + (ACROSS_M + ACROSS * distance) ** 2 * (np.eye(3) - along)
