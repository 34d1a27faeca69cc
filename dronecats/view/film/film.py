"""Makes a film file: parts drawn by several processes, encoded, and joined."""

import contextlib
import fcntl
import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

import cv2
import numpy as np
from PIL import Image

from dronecats.view.film.composition import Composition
from dronecats.view.film.lettering import BACKGROUND, DRONES, GREEN, MAGENTA, RED, WHITE, YELLOW, Picture
from dronecats.view.film.plan import FilmPlan, filmable
from episodes.authoring.processes import share_out
from foundation.errors import InfrastructureError, UsageError
from foundation.extras import not_installed
from foundation.files import write_json
from foundation.run_folder.reading import json_object
from foundation.threads import once

MANIFEST, LOCK, MAKING = "manifest.json", ".lock", ".making"

Codec = Literal["h264", "mp4v", "gif"]
PicturesDone = Callable[[int], object]  # told how many more pictures are there


@dataclass(frozen=True, slots=True)
class FilmParts:
    """The folder of a film's parts."""

    folder: Path
    plan: FilmPlan
    codec: Codec

    def path(self, number: int) -> Path:
        """Return the file of a part."""
        return self.folder / f"{number:05d}{SUFFIX[self.codec]}"

    def making(self, number: int) -> Path:
        """Return the file of a part while it is being written."""
        return self.folder / f"{number:05d}{MAKING}{SUFFIX[self.codec]}"

    @property
    def missing(self) -> list[int]:
        """The numbers of the parts that are not there yet."""
        return [number for number in range(len(self.plan.parts)) if not self.path(number).is_file()]

    @property
    def paths(self) -> list[Path]:
        """The files of all parts."""
        return [self.path(number) for number in range(len(self.plan.parts))]

    def remove(self) -> None:
        """Remove the folder with all that is in it."""
        shutil.rmtree(self.folder)


@dataclass(frozen=True, slots=True)
class FilmPart:
    """A part that is to be made: what a process is told."""

    parts: FilmParts
    number: int


def make(
    plan: FilmPlan, out: Path, jobs: int | None = None, progress: Callable[[int], PicturesDone] | None = None
) -> Codec:
    """Write a film, and return how it is encoded. For the main thread.

    `progress` is given how many pictures are there already, and returns what is told of each that comes; `jobs`: how
    many processes draw, None: one a core. What an unfinished film of the same command has left is gone on with. Raises
    UsageError when nothing can be written there, InfrastructureError when an encoder or a process fails.
    """
    codec = codec_for(out)
    with opened(out, plan, codec) as parts:
        missing = parts.missing
        done = plan.pictures - sum(len(plan.parts[number]) for number in missing)
        tell = progress(done) if progress else _nobody
        try:
            for number in share_out(draw_part, [FilmPart(parts, number) for number in missing], jobs):
                tell(len(plan.parts[number]))
            finished = parts.folder / f"film{out.suffix}"
            join(parts.paths, finished, plan, codec)
            finished.replace(out)
            parts.remove()
        except OSError as error:
            raise UsageError(f"{out} cannot be written: {error.strerror}; the same command goes on") from None
    return codec


def draw_part(part: FilmPart) -> int:
    """Draw and write one part, and return its number. In a process of its own, or in the caller's."""
    parts, plan = part.parts, part.parts.plan
    making = parts.making(part.number)
    write_part(making, _pictures(plan, part.number), plan, parts.codec)
    making.replace(parts.path(part.number))
    return part.number


def _pictures(plan: FilmPlan, number: int) -> Iterator[Picture]:
    drawn = composition(plan.folder, plan.width, plan.height, plan.drone)
    for picture in plan.parts[number]:
        yield drawn.at(plan.time_of(picture), plan.speed, over=picture >= plan.moving and plan.closing > 0)


@once(1)
def composition(folder: str, width: int, height: int, drone: int | None) -> Composition:
    """Return what draws the pictures of a film, made once in a process. Raises UsageError where it cannot be."""
    cv2.setNumThreads(1)  # a process draws on one core: there is one for each of them
    return Composition(filmable(Path(folder)), width, height, drone)


def _nobody(pictures: int) -> None:
    """Tell nobody how far it is."""


def folder_beside(out: Path) -> Path:
    """Return where the parts of a film are kept."""
    return out.with_name(out.name + ".parts")


@contextlib.contextmanager
def opened(out: Path, plan: FilmPlan, codec: Codec) -> Iterator[FilmParts]:
    """Yield the parts of a film, nobody else's; those of another film in their place are thrown away.

    Raises UsageError when nothing can be written there, or somebody else is making a film there.
    """
    if out.is_dir():
        raise UsageError(f"--out {out} is a folder; name a file in it")
    parts = FilmParts(folder_beside(out), plan, codec)
    try:
        parts.folder.mkdir(parents=True, exist_ok=True)
        lock: IO[str] = (parts.folder / LOCK).open("w")
    except OSError as error:
        raise UsageError(f"--out {out} cannot be written: {error.strerror}") from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UsageError(f"{out} is being made by another process; wait for it, or choose another --out") from None
        _begin(parts)
        yield parts


def _begin(parts: FilmParts) -> None:
    manifest = {"film": parts.plan.digest(parts.codec), "codec": parts.codec, "pictures": parts.plan.pictures}
    before = json_object(parts.folder / MANIFEST)
    for path in parts.folder.iterdir():
        if path.name not in (LOCK, MANIFEST) and (before != manifest or MAKING in path.name):
            path.unlink()
    write_json(parts.folder / MANIFEST, manifest)


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
