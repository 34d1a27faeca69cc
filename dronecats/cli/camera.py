"""Verb `camera`: measures the rate and latency of a camera's frames, and calibrates its lens."""

import argparse
import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dronecats.cli.next_commands import print_next
from dronecats.cli.output import print_line, show
from dronecats.report.table import ReportTable, table_of, words
from foundation.errors import UsageError

VIEWS_WANTED = 20  # number of different views of the board that a live camera must give


def add_camera_options(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    url_help = "http://…, rtsp://…, v4l2:0, a video file or a folder of pictures"
    check = actions.add_parser("check", help="measure rate, latency, drops and size of the frames")
    check.add_argument("url", metavar="URL", help=url_help)
    check.add_argument("--calibration", type=Path, metavar="FILE", help="OpenCV's calibration file of this camera")
    check.add_argument("--seconds", type=float, default=5.0, metavar="N", help="length of the measurement (default 5)")
    check.add_argument("--save", type=Path, metavar="FILE", help="write the last frame as the pilot sees it")
    check.add_argument("--json", action="store_true", help="print one JSON object")
    calibrate = actions.add_parser("calibrate", help="measure the lens from pictures of a chessboard")
    calibrate.add_argument("url", metavar="URL|FOLDER", help=url_help)
    calibrate.add_argument("--board", default="9x6", metavar="CxR", help="inner corners of the board (default 9x6)")
    calibrate.add_argument("--square", type=float, required=True, metavar="M", help="side of a square in metres")
    calibrate.add_argument("--out", type=Path, required=True, metavar="FILE", help="ends in .yml, .xml or .json")
    calibrate.add_argument(
        "--seconds", type=float, default=120.0, metavar="N", help="limit with a live camera (default 120)"
    )
    calibrate.add_argument("--json", action="store_true", help="print one JSON object at the end")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Check or calibrate a camera. The exit status is 2 for unusable input, 3 if the camera delivers no frame."""
    if not 0.1 <= args.seconds <= 3600.0:
        raise UsageError(f"--seconds must be 0.1 to 3600, got {args.seconds:g}")
    return _check(args) if args.action == "check" else _calibrate(args)


def _check(args: argparse.Namespace) -> int:
    import cv2

    from hil.cameras.lens import load
    from hil.cameras.measure import host_us, measure
    from hil.cameras.open import open_camera

    if args.save and not cv2.haveImageWriter(str(args.save)):
        raise UsageError(f"--save {str(args.save)!r} must end in .jpg or .png")
    began_s = time.monotonic()
    calibration = load(args.calibration) if args.calibration else None
    # no limit on the age: the time stamps may be on the vehicle's clock, which is not comparable with `host_us`
    camera = open_camera(args.url, host_us, calibration, max_age_s=math.inf)
    try:
        camera.newest()
        first_s = time.monotonic() - began_s
        delivery, frame = measure(camera, args.seconds)
    finally:
        camera.close()
    if args.save and not _written(args.save, cv2.cvtColor(frame.image_rgb, cv2.COLOR_RGB2BGR)):
        raise UsageError(f"--save {str(args.save)!r} cannot be written. Choose another file")
    measured = {"first_frame_s": first_s, **asdict(delivery)}
    if args.json:
        print(json.dumps(measured))
    else:
        show(_table(measured))
    return 0


def _written(path: Path, picture: Any) -> bool:
    import cv2

    try:
        return bool(cv2.imwrite(str(path), picture))
    except cv2.error:
        return False


def _table(measured: dict[str, Any]) -> ReportTable:
    """Return the measurements as a table of names and texts."""
    model = measured["model"]

    def ms(value: float | None) -> str:
        return "unknown" if value is None else f"{value:.0f} ms"

    source = (
        "from the calibration; the lens is corrected"
        if measured["calibrated"]
        else "assumed, so points are inexact; to measure it: dronecats camera calibrate"
    )
    rate = "unknown" if measured["rate_hz"] is None else f"{measured['rate_hz']:.1f} Hz"
    limit = ", limited by the time of a request" if measured["asked"] else ""
    age = (
        "unknown, because the time stamps are on the vehicle's clock"
        if measured["age_ms"] is None
        else f"{ms(measured['age_ms'])}, at worst {ms(measured['oldest_ms'])}, from its arrival on this computer"
        " until it is decoded"
    )
    return table_of(
        (words(""), words("")),
        (
            ("picture", f"{model['width']}×{model['height']} px, {model['hfov_deg']:.1f}° wide ({source})"),
            ("first frame", f"after {measured['first_frame_s']:.2f} s"),
            ("rate", f"{rate}{limit}, {measured['frames']} frames in {measured['seconds']:.1f} s"),
            ("interval", f"{ms(measured['interval_ms'])}, jitter {ms(measured['jitter_ms'])}, "
                         f"longest {ms(measured['longest_ms'])}"),
            ("age", age),
            ("missing", f"{measured['missing']} (gaps between the frames)"),
            ("repeated", f"{measured['repeated']} (equal to the frame before)"),
            ("skipped", f"{measured['unseen']} (arrived while this computer was busy with an earlier frame)"),
            ("reopened", f"{measured['reopened']} times"),
        ),
        "The camera's own delay (exposure, coding, network) is not included. To measure it: docs/cameras.md",
    )  # fmt: skip


def _calibrate(args: argparse.Namespace) -> int:
    from hil.cameras.lens import Lens, board_of, fit, save

    board = board_of(args.board, args.square)
    if args.out.suffix not in (".yml", ".yaml", ".xml", ".json"):
        raise UsageError(f"--out '{args.out}' must end in .yml, .yaml, .xml or .json")
    report: Callable[[str], None] = (lambda line: None) if args.json else print_line
    collect = _views_in_folder if Path(args.url).is_dir() else _views_of_camera
    views, width, height = collect(args, board, report)
    result = fit(views, board, width, height)
    model = Lens(result.calibration).model
    assert model is not None  # a calibration has the size of the pictures
    save(result.calibration, args.out)
    if args.json:
        print(json.dumps({**asdict(result), "hfov_deg": model.hfov_deg, "file": str(args.out)}))
        return 0
    matrix = result.calibration.matrix
    print(f"  views       {result.views}, the worst with an error of {result.worst_px:.2f} px")
    print(f"  error       {result.calibration.error_px:.3f} px, root mean square")
    print(f"  focal       {matrix[0][0]:.1f}, {matrix[1][1]:.1f} px ± {result.focal_sigma:.2%}")
    print(f"  centre      {matrix[0][2]:.1f}, {matrix[1][2]:.1f} px of {width}×{height}")
    print(f"  distortion  {', '.join(f'{k:.4f}' for k in result.calibration.distortion)}")
    print(f"  corners     in {result.coverage:.0%} of the picture")
    print(f"  corrected   {model.hfov_deg:.1f}° wide")
    print(f"written: {args.out}")
    if not Path(args.url).is_dir():
        print_next("camera calibrate", camera=args.url, file=args.out)
    return 0


def _views_in_folder(args: argparse.Namespace, board: Any, report: Callable[[str], None]) -> tuple[list[Any], int, int]:
    """Return (views, width, height): the board's corners in each picture that shows the board, and the size in px."""
    from hil.cameras.lens import corners
    from hil.cameras.stream import decoded, pictures

    views: list[Any] = []
    size: tuple[int, ...] | None = None
    for path in pictures(Path(args.url)):
        picture = decoded(path.read_bytes())
        if picture is None:
            raise UsageError(f"{path} cannot be read as a picture. Remove it from the folder")
        size = size or picture.shape
        if picture.shape != size:
            raise UsageError(f"{path} has another size than the pictures before it. Use pictures of one size")
        places = corners(picture, board)
        report(f"  {path.name}: {'no board' if places is None else 'seen'}")
        if places is not None:
            views.append(places)
    height, width = (size or (0, 0))[:2]
    return views, width, height


def _views_of_camera(args: argparse.Namespace, board: Any, report: Callable[[str], None]) -> tuple[list[Any], int, int]:
    """Return the corners of different views of the board from a live camera, and the pictures' width and height (px).

    The function ends after VIEWS_WANTED views, or after --seconds.
    """
    import cv2

    from hil.cameras.lens import corners, is_new
    from hil.cameras.measure import host_us
    from hil.cameras.open import open_camera
    from hil.cameras.stream import StreamEndedError

    camera = open_camera(args.url, host_us)
    views: list[Any] = []
    try:
        frame = camera.newest()
        height, width = frame.image_rgb.shape[:2]
        report(f"Hold the board still in the picture. Then move and tilt it, until there are {VIEWS_WANTED} views")
        end_s = time.monotonic() + args.seconds
        while len(views) < VIEWS_WANTED and time.monotonic() < end_s:
            places = corners(cv2.cvtColor(frame.image_rgb, cv2.COLOR_RGB2BGR), board)
            if places is not None and is_new(places, views, width):
                views.append(places)
                report(f"  view {len(views)} of {VIEWS_WANTED}")
            try:
                frame = camera.following(frame.frame_id)
            except StreamEndedError:  # the end of a recording
                break
    finally:
        camera.close()
    return views, width, height
