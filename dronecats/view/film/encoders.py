"""How pictures become a file: H.264 by the ffmpeg that a wheel brings, else what OpenCV has, and GIF.

Pictures are first kept in parts (`parts.py`), which are joined at the end. Parts of H.264 are joined as they are; those
of the others are JPEG pictures, encoded once more when all are there.
"""

import subprocess
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from PIL import Image

from dronecats.view.film.lettering import BACKGROUND, DRONES, GREEN, MAGENTA, RED, WHITE, YELLOW, Picture
from dronecats.view.film.plan import FilmPlan
from foundation.errors import InfrastructureError
from foundation.extras import not_installed

Codec = Literal["h264", "mp4v", "gif"]

CRF, PRESET = 23, "veryfast"
JPEG_QUALITY = 95  # of a part, which is encoded again: what it loses is not seen
GIF_COLORS = 128  # those of the marks and words among them, which are few pixels and what is looked at
GIF_SAMPLED = 24  # pictures that the palette is made from
GIF_STILL = 10  # of 255: a pixel that has changed by less than this in each channel stays, which keeps the file small
BRIGHT = (YELLOW, MAGENTA, GREEN, RED)
# and how they look at the edge of a letter, and a field of view on a road
DIM = tuple(tuple((a + b) // 2 for a, b in zip(mark, BACKGROUND, strict=True)) for mark in BRIGHT)
MARKS = (*BRIGHT, *DIM, WHITE, *DRONES, (112, 86, 34))
SUFFIX: dict[Codec, str] = {"h264": ".mp4", "mp4v": ".avi", "gif": ".avi"}


def codec_for(out: Path) -> Codec:
    """Return how a film is encoded on this machine."""
    if out.suffix.lower() == ".gif":
        return "gif"
    return "h264" if ffmpeg() else "mp4v"


def said(codec: Codec) -> str:
    """Return in a sentence what a film is encoded with."""
    if codec == "h264":
        return "H.264, by the ffmpeg of imageio-ffmpeg"
    if codec == "gif":
        return f"GIF of {GIF_COLORS} colours, by Pillow"
    return f"MPEG-4 part 2, by OpenCV, which no browser plays; for H.264, {not_installed('imageio_ffmpeg')}"


def ffmpeg() -> str | None:
    """Return the path of the ffmpeg that imageio-ffmpeg brings, None where there is none."""
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError, OSError):
        return None


def write_part(path: Path, pictures: Iterable[Picture], plan: FilmPlan, codec: Codec) -> None:
    """Write a part of a film. Raises InfrastructureError when the encoder fails."""
    if codec == "h264":
        _write_h264(path, pictures, plan)
        return
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), plan.fps, (plan.width, plan.height),
        [cv2.VIDEOWRITER_PROP_QUALITY, JPEG_QUALITY],
    )  # fmt: skip
    if not writer.isOpened():
        raise InfrastructureError(f"OpenCV cannot write {path}: the disk is full, or its build has no JPEG video")
    try:
        for picture in pictures:
            writer.write(np.ascontiguousarray(picture[..., ::-1]))
    finally:
        writer.release()


def _write_h264(path: Path, pictures: Iterable[Picture], plan: FilmPlan) -> None:
    # no B-frames: each part begins at its first picture, and parts that follow one another need no new times
    size, rate = f"{plan.width}x{plan.height}", str(plan.fps)
    command = [
        str(ffmpeg()), "-y", "-loglevel", "error",
        "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", rate, "-i", "-",
        "-an", "-c:v", "libx264", "-preset", PRESET, "-crf", str(CRF), "-bf", "0", "-threads", "1",
        "-vf", "scale=out_color_matrix=bt709:out_range=tv", "-pix_fmt", "yuv420p",
        "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709",
        "-f", "mp4", str(path),
    ]  # fmt: skip
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        try:
            for picture in pictures:
                process.stdin.write(np.ascontiguousarray(picture).tobytes())
            process.stdin.close()
        except BrokenPipeError:
            pass  # ffmpeg has given up, and says why
        except BaseException:
            process.kill()
            raise
        words = process.stderr.read().decode(errors="replace")
        if process.wait() != 0:
            raise _failed(words)


def _failed(words: str) -> InfrastructureError:
    return InfrastructureError(f"ffmpeg gave up: {(words.strip().splitlines() or ['it says nothing'])[-1][:200]}")


def join(parts: Sequence[Path], out: Path, plan: FilmPlan, codec: Codec) -> None:
    """Write the film of all its parts. Raises InfrastructureError when the encoder fails."""
    if codec == "h264":
        _join_h264(parts, out)
    elif codec == "gif":
        _join_gif(parts, out, plan)
    else:
        writer = cv2.VideoWriter(str(out), cv2.VideoWriter.fourcc(*"mp4v"), float(plan.fps), (plan.width, plan.height))
        if not writer.isOpened():
            raise InfrastructureError(f"OpenCV has no encoder for films, and {not_installed('imageio_ffmpeg')}")
        for picture in _read(parts):
            writer.write(picture)
        writer.release()


def _join_h264(parts: Sequence[Path], out: Path) -> None:
    listed = out.with_name(out.name + ".txt")
    quoted = (str(part.resolve()).replace("'", "'\\''") for part in parts)
    listed.write_text("".join(f"file '{each}'\n" for each in quoted), encoding="utf-8")
    command = [str(ffmpeg()), "-y", "-loglevel", "error", "-f", "concat", "-safe", "0", "-i", str(listed), "-c", "copy",
               "-movflags", "+faststart", "-f", "mp4", str(out)]  # fmt: skip
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    listed.unlink()
    if done.returncode != 0:
        raise _failed(done.stderr)


def _read(parts: Sequence[Path], every: int = 1) -> Iterator[Picture]:
    """Yield the pictures of parts, (H, W, 3) BGR."""
    number = 0
    for part in parts:
        reader = cv2.VideoCapture(str(part))
        while True:
            more, picture = reader.read()
            if not more:
                break
            if number % every == 0:
                yield np.asarray(picture, np.uint8)
            number += 1
        reader.release()


def _join_gif(parts: Sequence[Path], out: Path, plan: FilmPlan) -> None:
    palette = _palette(list(_read(parts, max(1, plan.pictures // GIF_SAMPLED))))
    shown: Picture | None = None

    def pictures() -> Iterator[Any]:
        nonlocal shown
        for bgr in _read(parts):
            rgb = bgr[..., ::-1]
            if shown is None:
                shown = rgb.copy()
            else:
                moved = (cv2.absdiff(shown, np.ascontiguousarray(rgb)) >= GIF_STILL).any(axis=2)
                shown[moved] = rgb[moved]
            yield Image.fromarray(shown).quantize(palette=palette, dither=Image.Dither.NONE)

    each = pictures()
    first = next(each)
    ms = 1000 / plan.fps
    first.save(
        out, "GIF", save_all=True, append_images=each, duration=round(ms / 10) * 10, loop=0, optimize=False, disposal=1
    )


def _palette(samples: Sequence[Picture]) -> Any:
    """Return a picture whose palette serves all of these."""
    width = max(1, samples[0].shape[1] // 2)
    height = max(1, samples[0].shape[0] // 2)
    small = [cv2.resize(each, (width, height), interpolation=cv2.INTER_NEAREST) for each in samples]
    together = np.ascontiguousarray(np.concatenate(small)[..., ::-1])
    found = Image.fromarray(together).quantize(GIF_COLORS - len(MARKS), method=Image.Quantize.MEDIANCUT)
    colors = [*(found.getpalette() or [])[: 3 * (GIF_COLORS - len(MARKS))], *(part for mark in MARKS for part in mark)]
    palette = Image.new("P", (1, 1))
    palette.putpalette(colors)
    return palette
