"""Measures how well the built-in pilot reads signs and plates, by distance and angle.

    python -m benchmarks.reading [--json] [--each N] [--short]

Renders single boards and cars, with inscriptions that no episode uses, as the picture that a pilot gets (640×360,
JPEG). Cuts out the line of text at its known place and reads it. Prints, for each kind, distance and viewing angle (0°:
head-on), how many lines were read fully, and how many were misread as a text of the right length that the pilot
accepts. Then prints the CPU milliseconds per line. `--short` takes seconds and only checks that every figure can be
measured.
"""

import json
import math
import time
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import benchmark_parser
from dronecats.cli.exit_status import exit_status
from dronecats.pilots.vision import ocr, pilot
from dronecats.pilots.vision.command import plain_text
from dronecats.pilots.vision.ocr import SURE_CONFIDENCE, ReadText
from episodes.authoring import asset_pictures as probe
from episodes.authoring.asset_pictures import alone
from episodes.authoring.scene_pictures import CENTRED, rendered
from episodes.maps import assets
from foundation.camera import CameraPose, encode
from foundation.frames import quat_from_euler

DISTANCES_M, ANGLES_DEG = (3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0), (0.0, 30.0, 45.0, 60.0)
PAINTS = ("black", "purple", "orange", "yellow", "blue", "green", "brown")
CARS = ("sedan", "suv", "hatchback", "pickup", "van")


@dataclass(frozen=True, slots=True)
class LegibilityRow:
    """The readings of one kind of inscription at one distance and angle."""

    kind: str
    distance_m: float
    angle_deg: float
    pictures: int
    package: int  # pictures that the OCR package reads fully
    wrong: int  # pictures with a wrong text of the right length that the pilot accepts


def text_for(kind: str, rng: np.random.Generator, taken: set[str]) -> str:
    """Return a text that no episode uses: five letters for a sign, four digits for a car."""
    letters, count = (probe.LETTERS, 5) if kind == "sign" else (probe.DIGITS, 4)
    while True:
        text = "".join(letters[k] for k in rng.integers(0, len(letters), count))
        if text not in taken:
            return text


def line_of(
    kind: probe.InscriptionKind, text: str, distance_m: float, angle_deg: float, eye_m: float
) -> NDArray[np.uint8]:
    """Return the part of the pilot's picture (BGR) with the line of text and a margin around it."""
    mesh = assets.build(kind.asset, kind.paint, text)
    face = probe.face_of(mesh, kind.material)
    side, angle = math.copysign(1.0, face.ahead), math.radians(angle_deg)
    eye = (face.ahead + side * distance_m * math.cos(angle), face.right + distance_m * math.sin(angle), -eye_m)
    yaw = math.atan2(face.right - eye[1], face.ahead - eye[0])
    pose = CameraPose(eye, quat_from_euler(0.0, 0.0, yaw))
    rgb = rendered(alone(kind.asset, mesh, probe.SUN), CENTRED, pose, shadow_cells=1024)
    seen = pilot.decode(encode(rgb))
    middle_y = 180.0 + 320.0 * (eye_m - face.height) / distance_m
    high = 1.7 * 320.0 * kind.letter_m / distance_m
    wide = high / 1.7 * 0.98 * len(text) * math.cos(angle)
    rows = slice(max(0, round(middle_y - high / 2)), round(middle_y + high / 2) + 1)
    return np.ascontiguousarray(seen[rows, round(320.0 - wide / 2) : round(320.0 + wide / 2) + 1])


def by_package(part: NDArray[np.uint8], angle_deg: float) -> ReadText:
    """Return the pilot's reading of `part`, which is first widened to undo the viewing angle."""
    lines = ocr.read_line(part, min(1.0 / math.cos(math.radians(angle_deg)), 3.0))
    return lines[0] if lines else ReadText("", 0.0)


def measure(
    distances: tuple[float, ...], angles: tuple[float, ...], pictures: int
) -> tuple[list[LegibilityRow], float]:
    """Return the rows, and the CPU milliseconds of one reading by the package."""
    rng, taken = np.random.default_rng(11), probe.used_inscriptions()
    ocr.load_engine()
    rows, spent_s, count = [], 0.0, 0
    for base in probe.KINDS:
        for distance in distances:
            for angle in angles:
                package = wrong = 0
                for k in range(pictures):
                    text = text_for(base.name, rng, taken)
                    asset = base.asset if base.name == "sign" else CARS[k % len(CARS)]
                    kind = probe.InscriptionKind(
                        base.name, asset, PAINTS[int(rng.integers(len(PAINTS)))], base.letter_m, base.material
                    )
                    part = line_of(kind, text, distance, angle, float(rng.uniform(1.2, 2.0)))
                    if min(part.shape[:2]) < 2:
                        continue
                    began = time.process_time()
                    reading = by_package(part, angle)
                    spent_s, count = spent_s + time.process_time() - began, count + 1
                    plain = plain_text(text)
                    read = plain_text(reading.text)
                    package += read == plain
                    wrong += read != plain and len(read) == len(plain) and reading.confidence >= SURE_CONFIDENCE
                rows.append(LegibilityRow(base.name, distance, angle, pictures, package, wrong))
    return rows, 1e3 * spent_s / max(1, count)


def main() -> int:
    """Print the figures; return the exit status."""
    parser = benchmark_parser(__doc__, short="read one picture of each kind, near and straight ahead")
    parser.add_argument("--each", type=int, default=10, help="pictures of each kind, distance and angle (default 10)")
    args = parser.parse_args()
    rows, cpu_ms = measure((4.0,), (0.0,), 1) if args.short else measure(DISTANCES_M, ANGLES_DEG, args.each)
    if args.json:
        print(json.dumps({"rows": [asdict(row) for row in rows], "cpu_ms_per_line": round(cpu_ms, 1)}))
        return 0
    for row in rows:
        print(
            f"{row.kind:5} {row.distance_m:4g} m {row.angle_deg:3g}°   package {row.package}/{row.pictures}"
            f"   believed and wrong {row.wrong}"
        )
    print(f"{cpu_ms:.1f} ms of CPU a line")
    return 0


if __name__ == "__main__":
    raise SystemExit(exit_status("benchmarks.reading", main))
