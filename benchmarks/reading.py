"""How well the built-in pilot reads signs and plates, against distance and angle.

    python -m benchmarks.reading [--json] [--each N] [--short]

renders boards and cars alone, with inscriptions that no episode uses, through the picture that a pilot gets (640×360,
JPEG), and reads each in two ways: with the OCR package, and with templates of our own digits and letters, drawn with
OpenCV's font and matched in equal cells. Printed per kind, distance and angle off square: the share read whole by
either, and wrong texts of the right length that the package gave with the confidence that the pilot believes; then
the CPU milliseconds a line takes. `--short` only shows, in seconds, that every figure can be had.
"""

import argparse
import json
import math
import time
from dataclasses import asdict, dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.pilots import inscription, reading, vision
from dronecats.pilots.inscription import SURE, ReadText
from episodes import assets
from episodes.pictures import probe
from episodes.pictures.studio import alone
from episodes.render.renderer import Renderer
from foundation import picture
from foundation.camera import CameraPose
from foundation.frames import quat_from_euler

DISTANCES_M, ANGLES_DEG = (3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0), (0.0, 30.0, 45.0, 60.0)
PAINTS = ("black", "purple", "orange", "yellow", "blue", "green", "brown")
CARS = ("sedan", "suv", "hatchback", "pickup", "van")
CELL_PX = (12, 16)  # width and height of a template's cell
ALPHABET = probe.DIGITS + probe.LETTERS


@dataclass(frozen=True, slots=True)
class LegibilityRow:
    """What was read of one kind at one distance and angle."""

    kind: str
    distance_m: float
    angle_deg: float
    pictures: int
    package: int  # read whole by the OCR package
    templates: int  # read whole by our own templates
    wrong: int  # believed, and another text of the same length


def text_for(kind: str, rng: np.random.Generator, taken: set[str]) -> str:
    """Return a sign's five letters or a car's four digits, that no episode uses."""
    letters, count = (probe.LETTERS, 5) if kind == "sign" else (probe.DIGITS, 4)
    while True:
        text = "".join(letters[k] for k in rng.integers(0, len(letters), count))
        if text not in taken:
            return text


def line_of(
    kind: probe.InscriptionKind, text: str, distance_m: float, angle_deg: float, eye_m: float
) -> NDArray[np.uint8]:
    """Return the part of the pilot's picture that the line of text fills, a margin about it, BGR."""
    mesh = assets.build(kind.asset, kind.paint, text)
    face = probe.face_of(mesh, kind.material)
    side, angle = math.copysign(1.0, face.ahead), math.radians(angle_deg)
    eye = (face.ahead + side * distance_m * math.cos(angle), face.right + distance_m * math.sin(angle), -eye_m)
    yaw = math.atan2(face.right - eye[1], face.ahead - eye[0])
    renderer = Renderer(alone(kind.asset, mesh, probe.SUN), probe.CAMERA, shadow_cells=1024)
    rgb = renderer.render(CameraPose(eye, quat_from_euler(0.0, 0.0, yaw))).rgb
    renderer.close()
    seen = vision.decode(picture.encode(rgb))
    middle_y = 180.0 + 320.0 * (eye_m - face.height) / distance_m
    high = 1.7 * 320.0 * kind.letter_m / distance_m
    wide = high / 1.7 * 0.98 * len(text) * math.cos(angle)
    rows = slice(max(0, round(middle_y - high / 2)), round(middle_y + high / 2) + 1)
    return np.ascontiguousarray(seen[rows, round(320.0 - wide / 2) : round(320.0 + wide / 2) + 1])


def by_templates(part: NDArray[np.uint8], count: int) -> str:
    """Return the text of so many characters that fits best: the inked columns in equal cells, each by correlation."""
    height, width = part.shape[:2]
    inner = part[round(0.18 * height) : round(0.82 * height), round(0.08 * width) : round(0.92 * width)]
    if min(inner.shape[:2]) < 2:
        return ""
    grey = cv2.cvtColor(np.ascontiguousarray(inner), cv2.COLOR_BGR2GRAY).astype(np.float32)
    grey = cv2.resize(grey, None, fx=4.0, fy=4.0, interpolation=cv2.INTER_CUBIC)
    ink = np.abs(grey - np.median(grey))
    strong = ink > 0.4 * np.percentile(ink, 98.0)
    columns, rows = np.flatnonzero(strong.mean(axis=0) > 0.08), np.flatnonzero(strong.mean(axis=1) > 0.08)
    if len(columns) < count or len(rows) < 2:
        return ""
    cut = ink[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    row = cv2.resize(cut, (CELL_PX[0] * count, CELL_PX[1]), interpolation=cv2.INTER_AREA)
    cells = [row[:, k * CELL_PX[0] : (k + 1) * CELL_PX[0]].ravel() for k in range(count)]
    return "".join(max(ALPHABET, key=lambda c: float(np.corrcoef(cell, template(c))[0, 1])) for cell in cells)


def template(character: str) -> NDArray[np.float32]:
    """Return a character drawn to fill a cell, as a flat array."""
    drawn = np.zeros((96, 96), np.uint8)
    cv2.putText(drawn, character, (16, 76), cv2.FONT_HERSHEY_SIMPLEX, 2.4, 255, 10, cv2.LINE_AA)
    x, y, w, h = cv2.boundingRect(drawn)
    return np.asarray(
        cv2.resize(drawn[y : y + h, x : x + w], CELL_PX, interpolation=cv2.INTER_AREA), np.float32
    ).ravel()


def by_package(part: NDArray[np.uint8], angle_deg: float) -> ReadText:
    """Return what the pilot's reader makes of a line, widened as it is when it is seen aslant."""
    found = reading.line(part, min(1.0 / math.cos(math.radians(angle_deg)), 3.0))
    return found[0] if found else ReadText("", 0.0)


def measure(distances: tuple[float, ...], angles: tuple[float, ...], each: int) -> tuple[list[LegibilityRow], float]:
    """Return the rows, and the CPU milliseconds of one reading by the package."""
    rng, taken = np.random.default_rng(11), probe.used()
    reading.ready()
    rows, spent_s, count = [], 0.0, 0
    for base in probe.KINDS:
        for distance in distances:
            for angle in angles:
                package = templates = wrong = 0
                for k in range(each):
                    text = text_for(base.name, rng, taken)
                    asset = base.asset if base.name == "sign" else CARS[k % len(CARS)]
                    kind = probe.InscriptionKind(
                        base.name, asset, PAINTS[int(rng.integers(len(PAINTS)))], base.letter_m, base.material
                    )
                    part = line_of(kind, text, distance, angle, float(rng.uniform(1.2, 2.0)))
                    if min(part.shape[:2]) < 2:
                        continue
                    began = time.process_time()
                    said = by_package(part, angle)
                    spent_s, count = spent_s + time.process_time() - began, count + 1
                    plain = inscription.plain(text)
                    read = inscription.plain(said.text)
                    package += read == plain
                    wrong += read != plain and len(read) == len(plain) and said.confidence >= SURE
                    templates += by_templates(part, len(text)) == plain
                rows.append(LegibilityRow(base.name, distance, angle, each, package, templates, wrong))
    return rows, 1e3 * spent_s / max(1, count)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reading", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--each", type=int, default=10, help="pictures of each kind, distance and angle (default 10)")
    parser.add_argument("--short", action="store_true", help="one picture of each kind, near and square on")
    args = parser.parse_args()
    rows, cpu_ms = measure((4.0,), (0.0,), 1) if args.short else measure(DISTANCES_M, ANGLES_DEG, args.each)
    if args.json:
        print(json.dumps({"rows": [asdict(row) for row in rows], "cpu_ms_per_line": round(cpu_ms, 1)}))
        return
    for row in rows:
        print(
            f"{row.kind:5} {row.distance_m:4g} m {row.angle_deg:3g}°   package {row.package}/{row.pictures}"
            f"   templates {row.templates}/{row.pictures}   believed and wrong {row.wrong}"
        )
    print(f"{cpu_ms:.1f} ms of CPU a line")


if __name__ == "__main__":
    main()
