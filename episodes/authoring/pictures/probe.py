"""The reading probe: from how far can an inscription be read in the pictures that a model gets?

Paper, appendix "Maps and Episodes": one probe per inscription type, the sign with letters of 0.136 m and the plate with
digits of 0.10 m, benchmark-sized renders through the 640 px pipeline, with inscriptions that no episode uses.
"""

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.authoring.pictures.contact_sheet import alone
from episodes.camera.renderer.renderer import Renderer
from episodes.maps import assets
from episodes.maps.assets.exhibits import LETTER_M
from episodes.maps.assets.vehicles import DIGIT_M
from episodes.maps.scene import Mesh, Sun
from episodes.records import catalogue
from foundation import picture
from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError
from foundation.frames import quat_from_euler

DISTANCES_M = (4, 6, 8, 10, 12, 14, 16)  # from the camera to the inscription's plane
LEAST_EYE_M = 1.2  # above the ground: no lower than an episode's camera starts
SUN = Sun((-0.60, 0.35, -0.7194))  # over the camera's shoulder: what is read is an asset's rear, which faces south
CROP_PX, CELL_PX, LABEL_PX = (160, 90), (320, 180), 22  # of the contact sheet: cut out, and twice enlarged
LETTERS, DIGITS = "ABCDEFGHJKLMNPRSTUVWXYZ", "0123456789"  # without I, O and Q, as on most plates
CAMERA = CameraModel(1280, 720, 90.0, (0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class InscriptionKind:
    """One type of inscription and the asset that carries it."""

    name: str
    asset: str
    paint: str
    letter_m: float  # m, height of a capital or a digit
    material: str  # how the names of the material that shows it begin


KINDS = (
    InscriptionKind("sign", "sign", "white", LETTER_M, "sign-"),
    InscriptionKind("plate", "suv", "cyan", DIGIT_M, "plate-"),
)


@dataclass(frozen=True, slots=True)
class Probe:
    """One picture of the probe."""

    file: str  # within the folder
    kind: str  # sign or plate
    text: str  # what there is to read
    distance_m: float  # from the camera to the inscription's plane, along the optical axis
    letter_px: float  # height of its letters in the picture that the model gets: f · letter_m / distance_m


@dataclass(frozen=True, slots=True)
class Face:
    """Where an asset shows its inscription. Metres, the asset's own axes."""

    ahead: float  # of the asset's origin, along its nose; negative is the rear
    right: float  # of its middle
    height: float  # of its middle above the ground


def write_probe(folder: Path, seed: int = 0) -> list[Probe]:
    """Write the pictures, `index.json` and `contact-sheet.png`, and return what there is, nearest first per kind.

    The same seed gives the same bytes. Raises UsageError for a folder that cannot be written.
    """
    rng, taken = np.random.default_rng(seed), used()
    probes: list[Probe] = []
    rows = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for kind in KINDS:
            cells = []
            for distance in DISTANCES_M:
                text = invent(kind.name, rng, taken)
                taken.add(text)
                data = picture.encode(view(kind, text, distance))
                probe = Probe(
                    f"{kind.name}-{distance:02d}m.jpg", kind.name, text, float(distance), letter_px(kind, distance)
                )
                (folder / probe.file).write_bytes(data)
                probes.append(probe)
                cells.append(_cell(data, probe))
            rows.append(np.concatenate(cells, axis=1))
        (folder / "index.json").write_text(
            json.dumps({"seed": seed, "probes": [asdict(p) for p in probes]}, indent=2) + "\n", encoding="utf-8"
        )
        (folder / "contact-sheet.png").write_bytes(cv2.imencode(".png", np.concatenate(rows))[1].tobytes())
    except OSError as error:
        raise UsageError(f"the probe cannot be written to '{folder}': {error.strerror}; choose another --out") from None
    return probes


def letter_px(kind: InscriptionKind, distance_m: float) -> float:
    """Return the height of a letter in the model's picture, px, by the pinhole."""
    scale = min(1.0, picture.WIDTH_MAX / CAMERA.width)
    return round(CAMERA.focal_px * scale * kind.letter_m / distance_m, 2)


def used() -> set[str]:
    """Return every inscription that an episode's record names, and what stands on what none is named for."""
    found = {assets.PLATE}
    for name in catalogue.ids():
        record = catalogue.load(name)
        found.update(thing.inscription for thing in (record.target, *record.candidates) if thing.inscription)
    return found


def invent(kind: str, rng: np.random.Generator, taken: set[str]) -> str:
    """Return an inscription that is not `taken`: a sign's three letters and two digits, or a plate's two and four."""
    while True:
        letters = "".join(LETTERS[k] for k in rng.integers(0, len(LETTERS), 3 if kind == "sign" else 2))
        digits = "".join(DIGITS[k] for k in rng.integers(0, 10, 2 if kind == "sign" else 4))
        text = f"{letters} {digits}"
        if text not in taken:
            return text


def view(kind: InscriptionKind, text: str, distance_m: float) -> NDArray[np.uint8]:
    """Return the camera's (720, 1280, 3) RGB frame of an inscription straight ahead at a distance.

    The camera is level, at the inscription's own height where that is not below `LEAST_EYE_M`.
    """
    mesh = assets.build(kind.asset, kind.paint, text)
    face = face_of(mesh, kind.material)
    renderer = Renderer(alone(kind.asset, mesh, SUN), CAMERA, shadow_cells=4096)
    side = math.copysign(1.0, face.ahead)
    eye = (face.ahead + side * distance_m, face.right, -max(LEAST_EYE_M, face.height))
    try:
        return renderer.render(CameraPose(eye, quat_from_euler(0.0, 0.0, math.pi if side > 0.0 else 0.0))).rgb
    finally:
        renderer.close()


def face_of(mesh: Mesh, material: str) -> Face:
    """Return the rearmost inscription of a mesh: what a drone that follows would read."""
    number = next(k for k, m in enumerate(mesh.materials) if m.name.startswith(material))
    corners = mesh.vertices[mesh.triangles[mesh.material == number]]
    rear = float(corners[..., 0].min())
    places = corners[np.abs(corners[..., 0] - rear).max(axis=1) < 0.01].reshape(-1, 3).astype(float)
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    return Face(rear, float(middle[1]), float(-middle[2]))


def _cell(data: bytes, probe: Probe) -> NDArray[np.uint8]:
    """Return the middle of one picture, enlarged without smoothing, below its distance and text; BGR."""
    seen = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert seen is not None  # `data` is what `picture.encode` has just written
    focal = CAMERA.focal_px * seen.shape[1] / CAMERA.width
    kind = next(k for k in KINDS if k.name == probe.kind)
    face = face_of(assets.build(kind.asset, kind.paint, probe.text), kind.material)
    low = focal * max(0.0, LEAST_EYE_M - face.height) / probe.distance_m
    left = (seen.shape[1] - CROP_PX[0]) // 2
    top = min(round(seen.shape[0] / 2 + low - CROP_PX[1] / 2), seen.shape[0] - CROP_PX[1])
    cut = cv2.resize(seen[top : top + CROP_PX[1], left : left + CROP_PX[0]], CELL_PX, interpolation=cv2.INTER_NEAREST)
    label = np.full((LABEL_PX, CELL_PX[0], 3), 246, np.uint8)
    said = f"{probe.distance_m:g} m: {probe.text}, {probe.letter_px:g} px"
    cv2.putText(label, said, (6, LABEL_PX - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (42, 38, 36), 1, cv2.LINE_AA)
    return np.concatenate((label, cut))
