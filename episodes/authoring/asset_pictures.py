"""Draws single assets on level ground, for contact sheets and for the reading probe.

A contact sheet shows assets at several distances, at the resolution of the language model's pictures. The reading probe
shows inscriptions at several distances, to test from how far a model can read them. Source: paper, appendix "Maps and
Episodes". The paper has one probe for each type of inscription: a sign with letters of 0.136 m and a plate with digits
of 0.10 m. The pictures are rendered at 1280×720 px and reduced to a width of 640 px, like the model's pictures. No
episode uses the inscriptions of the probe.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np

from episodes.authoring.scene_pictures import CENTRED, jpeg, rendered, write_picture
from episodes.camera.renderer.renderer import Renderer
from episodes.maps import assets
from episodes.maps import geometry as g
from episodes.maps.assets.lettering import LETTER_M
from episodes.maps.assets.materials import surface
from episodes.maps.assets.multirotor import X500, multirotor
from episodes.maps.assets.vehicles import DIGIT_M
from episodes.maps.scene import Instance, Mesh, Picture, Scene, Sun
from episodes.records import catalogue
from foundation.camera import WIDTH_MAX, CameraPose, encode
from foundation.errors import UsageError
from foundation.files import file_errors_as
from foundation.frames import quat_from_euler
from foundation.terrain import FLAT
from foundation.wording import suggestion

GROUND_M = 160.0  # half the ground's width

# Contact sheets
DISTANCES_M = (6.0, 12.0, 24.0, 48.0)  # from camera to the asset's bounding box, along the line to the asset's origin
WIDTHS_PX = (448, 320, 192, 128)  # of the tiles, one per distance; each tile is cut from the middle of the picture
HEIGHT_PX, LABEL_PX, GAP_PX = 248, 26, 6  # height of a tile, height of a caption, gap between tiles
EYE_M = 1.6  # height of the camera above the ground
QUARTER_DEG = 35.0  # bearing of the camera from the asset, to the right of the asset's nose
SEEN_PX = (640, 360)  # size of the reduced frame
SHADE = Sun((0.22, 0.62, -0.753))  # sun of the contact sheets, behind the camera
PAINTS = ("cyan", "red", "yellow", "green", "orange", "blue", "purple", "pink")  # one per row, in turn
INSCRIPTIONS = {"sign": "GATE 7"}
DRONE, HOVER_M = "drone", 1.3  # the drone's name (it is not an asset of records), and its height above the ground
QUALITY = 75
INK, PAGE = (36, 38, 42), (246, 246, 244)

# The reading probe
PROBE_DISTANCES_M = (4, 6, 8, 10, 12, 14, 16)  # from the camera to the inscription's plane
LEAST_EYE_M = 1.2  # least height of the camera above the ground, the same as at an episode's start
SUN = Sun((-0.60, 0.35, -0.7194))  # sun of the probe, behind the camera; the camera looks north, at the asset's rear
CROP_PX, CELL_PX, CELL_LABEL_PX = (160, 90), (320, 180), 22  # the probe's contact sheet: crop, enlarged crop, label
LETTERS, DIGITS = "ABCDEFGHJKLMNPRSTUVWXYZ", "0123456789"  # letters without I, O and Q, as on most plates


def alone(name: str, mesh: Mesh, sun: Sun, height_m: float = 0.0) -> Scene:
    """Return a scene of one asset on asphalt. The asset faces north, with its origin `height_m` above the ground."""
    corner = [(GROUND_M * x, GROUND_M * y, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    flat = g.soup([[corner[i] for i in (0, 1, 2)], [corner[i] for i in (0, 2, 3)]], surface("asphalt"), tile_m=4.0)
    ground = Instance(1, "ground", "ground", g.assemble([flat]), (0.0, 0.0, 0.0))
    return Scene("studio", (ground, Instance(2, name, name, mesh, (0.0, 0.0, -height_m))), FLAT, sun, 47.0, 8.0, 400.0)


def names() -> list[str]:
    """Return the names that a contact sheet can show: assets, campus fixtures, street scenery and the drone."""
    return [*assets.names(), *sorted(assets.FIXTURES), *sorted(assets.SCENERY), DRONE]


def write_contact_sheet(chosen: Sequence[str], out: Path) -> None:
    """Write a JPEG with one row per asset and one column per distance.

    If `chosen` is empty, the sheet shows all `names()`. Each tile is cut from a 1280×720 frame that was reduced to a
    width of 640 px. The same names give the same bytes. Raises UsageError for an unknown name, or for a file that
    cannot be written.
    """
    catalogued = names()
    for name in chosen:
        if name not in catalogued:
            raise UsageError(f"asset '{name}' does not exist: {suggestion(name, catalogued)}")
    rows = [_row(name, PAINTS[k % len(PAINTS)]) for k, name in enumerate(chosen or catalogued)]
    heads = [_caption(f"{d:g} m", w + GAP_PX) for d, w in zip(DISTANCES_M, WIDTHS_PX, strict=True)]
    write_picture(jpeg(np.concatenate([np.concatenate(heads, axis=1), *rows]), QUALITY), out)


def _mesh(name: str, paint: str) -> Mesh:
    if name in assets.names():
        return assets.build(name, paint, INSCRIPTIONS.get(name))
    if name == DRONE:
        return multirotor(X500)
    return (assets.FIXTURES.get(name) or assets.SCENERY[name])()


def _row(name: str, paint: str) -> Picture:
    """Return the tiles of one asset side by side, below a caption."""
    mesh = _mesh(name, paint)
    renderer = Renderer(alone(name, mesh, SHADE, HOVER_M if name == DRONE else 0.0), CENTRED, shadow_cells=2048)
    turn = math.radians(QUARTER_DEG)
    ahead, right = mesh.vertices[:, :2].max(axis=0).astype(float)
    reach = min(ahead / math.cos(turn), right / math.sin(turn))
    tiles = []
    try:
        for distance, width in zip(DISTANCES_M, WIDTHS_PX, strict=True):
            away = reach + distance
            eye = (away * math.cos(turn), away * math.sin(turn), -EYE_M)
            frame = renderer.picture(CameraPose(eye, quat_from_euler(0.0, 0.0, turn + math.pi)))
            seen = cv2.resize(frame, SEEN_PX, interpolation=cv2.INTER_AREA)
            left, top = (SEEN_PX[0] - width) // 2, (SEEN_PX[1] - HEIGHT_PX) // 2
            tiles.append(_framed(seen[top : top + HEIGHT_PX, left : left + width]))
    finally:
        renderer.close()
    label = f"{name}, {paint}" if name in assets.names() else name
    return np.concatenate([_caption(label, sum(t.shape[1] for t in tiles)), np.concatenate(tiles, axis=1)])


def _framed(tile: Picture) -> Picture:
    return np.asarray(np.stack([np.pad(tile[..., k], GAP_PX // 2, constant_values=PAGE[k]) for k in range(3)], axis=2))


def _caption(text: str, width: int) -> Picture:
    strip = np.full((LABEL_PX, width, 3), PAGE, np.uint8)
    cv2.putText(strip, text, (GAP_PX, LABEL_PX - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.55, INK, 1, cv2.LINE_AA)
    return strip


@dataclass(frozen=True, slots=True)
class InscriptionKind:
    """One type of inscription and the asset that carries it."""

    name: str
    asset: str
    paint: str
    letter_m: float  # m, height of a capital or a digit
    material: str  # prefix of the name of the material that shows the inscription


KINDS = (
    InscriptionKind("sign", "sign", "white", LETTER_M, "sign-"),
    InscriptionKind("plate", "suv", "cyan", DIGIT_M, "plate-"),
)


@dataclass(frozen=True, slots=True)
class Probe:
    """One picture of the reading probe."""

    file: str  # name in the folder
    kind: str  # sign or plate
    text: str  # the inscription
    distance_m: float  # from the camera to the inscription's plane, along the optical axis
    letter_px: float  # height of the letters in the picture that the model gets: f · letter_m / distance_m


@dataclass(frozen=True, slots=True)
class Face:
    """The position (m) of the middle of an inscription on its asset."""

    ahead: float  # distance ahead of the asset's origin; negative: behind it
    right: float  # distance to the right of the asset's origin
    height: float  # height above the ground


def write_probe(folder: Path, seed: int = 0) -> list[Probe]:
    """Write the pictures, `index.json` and `contact-sheet.png`; return the probes, nearest first per kind.

    The same seed gives the same bytes. Raises UsageError for a folder that cannot be written.
    """
    rng, taken = np.random.default_rng(seed), used_inscriptions()
    probes: list[Probe] = []
    rows = []
    with file_errors_as(UsageError, f"the probe cannot be written to '{folder}'", ". Choose another --out"):
        folder.mkdir(parents=True, exist_ok=True)
        for kind in KINDS:
            cells = []
            for distance in PROBE_DISTANCES_M:
                text = invent(kind.name, rng, taken)
                taken.add(text)
                data = encode(view(kind, text, distance))
                file = f"{kind.name}-{distance:02d}m.jpg"
                probe = Probe(file, kind.name, text, float(distance), letter_px(kind, distance))
                (folder / probe.file).write_bytes(data)
                probes.append(probe)
                cells.append(_cell(data, probe))
            rows.append(np.concatenate(cells, axis=1))
        index = json.dumps({"seed": seed, "probes": [asdict(p) for p in probes]}, indent=2)
        (folder / "index.json").write_text(index + "\n", encoding="utf-8")
        (folder / "contact-sheet.png").write_bytes(cv2.imencode(".png", np.concatenate(rows))[1].tobytes())
    return probes


def letter_px(kind: InscriptionKind, distance_m: float) -> float:
    """Return the height (px) of a letter in the model's picture, by the pinhole model."""
    scale = min(1.0, WIDTH_MAX / CENTRED.width)
    return round(CENTRED.focal_px * scale * kind.letter_m / distance_m, 2)


def used_inscriptions() -> set[str]:
    """Return the inscriptions of all episode records, and the default text of number plates."""
    inscriptions = {assets.PLATE}
    for name in catalogue.ids():
        record = catalogue.load(name)
        inscriptions.update(t.inscription for t in (record.target, *record.candidates) if t.inscription)
    return inscriptions


def invent(kind: str, rng: np.random.Generator, taken: set[str]) -> str:
    """Return an inscription that is not in `taken`.

    A sign gets three letters and two digits, a plate two letters and four digits.
    """
    while True:
        letters = "".join(LETTERS[k] for k in rng.integers(0, len(LETTERS), 3 if kind == "sign" else 2))
        digits = "".join(DIGITS[k] for k in rng.integers(0, 10, 2 if kind == "sign" else 4))
        text = f"{letters} {digits}"
        if text not in taken:
            return text


def view(kind: InscriptionKind, text: str, distance_m: float) -> Picture:
    """Return the (720, 1280, 3) RGB frame of an inscription `distance_m` ahead of the camera.

    The camera is level, at the height of the inscription or at `LEAST_EYE_M`, whichever is higher.
    """
    mesh = assets.build(kind.asset, kind.paint, text)
    face = face_of(mesh, kind.material)
    side = math.copysign(1.0, face.ahead)
    eye = (face.ahead + side * distance_m, face.right, -max(LEAST_EYE_M, face.height))
    pose = CameraPose(eye, quat_from_euler(0.0, 0.0, math.pi if side > 0.0 else 0.0))
    return rendered(alone(kind.asset, mesh, SUN), CENTRED, pose, shadow_cells=4096)


def face_of(mesh: Mesh, material: str) -> Face:
    """Return the position of the rearmost inscription of a mesh. A drone behind the asset can read it."""
    number = next(k for k, m in enumerate(mesh.materials) if m.name.startswith(material))
    corners = mesh.vertices[mesh.triangles[mesh.material == number]]
    rear = float(corners[..., 0].min())
    places = corners[np.abs(corners[..., 0] - rear).max(axis=1) < 0.01].reshape(-1, 3).astype(float)
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    return Face(rear, float(middle[1]), float(-middle[2]))


def _cell(data: bytes, probe: Probe) -> Picture:
    """Return the part of a picture with the inscription (BGR, enlarged without smoothing), captioned."""
    seen = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert seen is not None  # `data` is a JPEG from `encode`
    focal = CENTRED.focal_px * seen.shape[1] / CENTRED.width
    kind = next(k for k in KINDS if k.name == probe.kind)
    face = face_of(assets.build(kind.asset, kind.paint, probe.text), kind.material)
    low = focal * max(0.0, LEAST_EYE_M - face.height) / probe.distance_m
    left = (seen.shape[1] - CROP_PX[0]) // 2
    top = min(round(seen.shape[0] / 2 + low - CROP_PX[1] / 2), seen.shape[0] - CROP_PX[1])
    cut = cv2.resize(seen[top : top + CROP_PX[1], left : left + CROP_PX[0]], CELL_PX, interpolation=cv2.INTER_NEAREST)
    label = np.full((CELL_LABEL_PX, CELL_PX[0], 3), 246, np.uint8)
    caption = f"{probe.distance_m:g} m: {probe.text}, {probe.letter_px:g} px"
    cv2.putText(label, caption, (6, CELL_LABEL_PX - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (42, 38, 36), 1, cv2.LINE_AA)
    return np.concatenate((label, cut))
