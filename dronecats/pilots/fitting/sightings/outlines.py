"""Where the paint of the catalogue's vehicles is: some points on the outside of it, by which a picture is ranged."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dronecats.pilots.fitting.sightings.neighbourhoods import NOUNS
from episodes.maps import assets

PAINT = "red"  # any: an asset's shape does not depend on it
LEVELS = 6  # heights between which points are taken
STEEP = 6.0  # slope of the directions in which its highest and lowest points are taken
WAYS = 8  # directions in plan, in each of which the outermost point of a level is taken


def points(asset: str) -> NDArray[np.float32]:
    """Return points (P, 3) m, forward, right and up, on the outside of an asset's painted surface, each once."""
    mesh = assets.build(asset, PAINT)
    painted = [i for i, one in enumerate(mesh.materials) if one.name in (f"paint-{PAINT}", f"cloth-{PAINT}")]
    corners = mesh.vertices[mesh.triangles[np.isin(mesh.material, painted)]]  # (T, 3, 3)
    a, b = (v.ravel() for v in np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9)))
    a, b = a[a + b <= 1.0], b[a + b <= 1.0]
    surface = np.einsum("kp,tkc->tpc", np.stack((a, b, 1.0 - a - b)), corners).reshape(-1, 3) * (1.0, 1.0, -1.0)
    edges = np.linspace(surface[:, 2].min(), surface[:, 2].max(), LEVELS + 1)
    found = []
    for low, high in pairwise(edges.tolist()):
        level = surface[(surface[:, 2] >= low) & (surface[:, 2] <= high)]
        for turn in np.arange(WAYS) * 2.0 * np.pi / WAYS:
            out = level @ (np.cos(turn), np.sin(turn), 0.0)
            at = level[out >= out.max() - 0.03] if len(level) else level
            if len(at):
                found += [at[at[:, 2].argmin()], at[at[:, 2].argmax()]]
    for turn in np.arange(WAYS) * 2.0 * np.pi / WAYS:  # and what stands out above and below
        for up in (-STEEP, STEEP):
            found.append(surface[(surface @ (np.cos(turn), np.sin(turn), up)).argmax()])
    return np.unique(np.round(np.array(found), 2).astype(np.float32), axis=0)


def write(file: Path) -> None:
    """Write the outlines of everything that a residential record may have for its target."""
    outlines: dict[str, Any] = {asset: points(asset) for asset in NOUNS}
    np.savez(file, **outlines)
