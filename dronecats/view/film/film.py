"""Makes a film file: several processes draw and encode parts of the film; then one process joins the parts.

Parts are files in a folder beside the film. A part gets its final name only when it is complete. If the process is
killed, the same command keeps the parts with final names and makes the others. The ffmpeg of imageio-ffmpeg encodes
parts as H.264 and joins them without encoding again. Without this ffmpeg, and for GIF, parts are Motion JPEG, and
joining them encodes the film again.
"""

import contextlib
import fcntl
import itertools
import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any, Literal

import cv2
import numpy as np
from PIL import Image

from dronecats.view.film.composition import Composition
from dronecats.view.film.lettering import BACKGROUND, DRONES, GREEN, MAGENTA, RED, WHITE, YELLOW, Picture
from dronecats.view.film.plan import FilmPlan, filmable
from episodes.authoring.processes import process_map
from foundation.errors import InfrastructureError, UsageError
from foundation.extras import not_installed
from foundation.files import file_errors_as, write_json
from foundation.run_folder.reading import json_object
from foundation.threads import once

MANIFEST, LOCK, MAKING = "manifest.json", ".lock", ".making"
CRF, PRESET = 23, "veryfast"
JPEG_QUALITY = 95  # of Motion JPEG parts, which `join` encodes again; the loss is not visible
GIF_COLORS = 128  # including MARKS, colours of marks and text, which are too rare for the quantizer to keep
GIF_SAMPLED = 24  # number of pictures from which the palette is computed
GIF_STILL = 10  # of 255; pixels that change by less in every channel keep their value, for a smaller file
BRIGHT = (YELLOW, MAGENTA, GREEN, RED)
# the colours BRIGHT at the edges of letters, mixed with the background
DIM = tuple(tuple((a + b) // 2 for a, b in zip(mark, BACKGROUND, strict=True)) for mark in BRIGHT)
MARKS = (*BRIGHT, *DIM, WHITE, *DRONES, (112, 86, 34))  # last: a field of view drawn over a road

Codec = Literal["h264", "mp4v", "gif"]
PicturesDone = Callable[[int], object]  # takes the number of pictures that were drawn since the last call
SUFFIX: dict[Codec, str] = {"h264": ".mp4", "mp4v": ".avi", "gif": ".avi"}


@dataclass(frozen=True, slots=True)
class PartsFolder:
    """The parts of a film, as files in a folder."""

    folder: Path
    plan: FilmPlan
    codec: Codec

    def path(self, number: int) -> Path:
        return self.folder / f"{number:05d}{SUFFIX[self.codec]}"

    @property
    def missing(self) -> list[int]:
        """The numbers of the parts that do not exist yet."""
        return [number for number in range(len(self.plan.part_ranges)) if not self.path(number).is_file()]


def make(
    plan: FilmPlan, out: Path, jobs: int | None = None, progress: Callable[[int], PicturesDone] | None = None
) -> Codec:
    """Write a film, and return its codec. Call it from the main thread only.

    `progress` takes the number of pictures that exist already, and returns a function that takes the number of new
    pictures. `jobs`: number of drawing processes, None: one per core. An unfinished film of the same plan is resumed.
    Raises UsageError if the film cannot be written, InfrastructureError if an encoder or a process fails.
    """
    codec = codec_for(out)
    with open_parts(out, plan, codec) as parts_folder:
        missing = parts_folder.missing
        done = plan.pictures - sum(len(plan.part_ranges[number]) for number in missing)
        report = progress(done) if progress else None
        with file_errors_as(UsageError, f"{out} cannot be written", ". The same command resumes"):
            for number in process_map(partial(draw_part, parts_folder), missing, jobs):
                if report is not None:
                    report(len(plan.part_ranges[number]))
            film = parts_folder.folder / f"film{out.suffix}"
            join([parts_folder.path(number) for number in range(len(plan.part_ranges))], film, plan, codec)
            film.replace(out)
            shutil.rmtree(parts_folder.folder)
    return codec


def draw_part(parts_folder: PartsFolder, number: int) -> int:
    """Draw and write one part, and return its number. A worker process or the caller's process runs it."""
    plan, path = parts_folder.plan, parts_folder.path(number)
    unfinished = path.with_name(f"{path.stem}{MAKING}{path.suffix}")
    write_part(unfinished, _pictures(plan, number), plan, parts_folder.codec)
    unfinished.replace(path)
    return number


def _pictures(plan: FilmPlan, number: int) -> Iterator[Picture]:
    drawing = composition(plan.folder, plan.width, plan.height, plan.drone)
    for picture in plan.part_ranges[number]:
        yield drawing.at(plan.time_of(picture), plan.speed, over=picture >= plan.moving and plan.closing > 0)


@once(1)
def composition(folder: str, width: int, height: int, drone: int | None) -> Composition:
    """Return the composition of a film, cached per process. Raises UsageError if the flight cannot be filmed."""
    cv2.setNumThreads(1)  # there is one process per core
    return Composition(filmable(Path(folder)), width, height, drone)


def folder_beside(out: Path) -> Path:
    return out.with_name(out.name + ".parts")


@contextlib.contextmanager
def open_parts(out: Path, plan: FilmPlan, codec: Codec) -> Iterator[PartsFolder]:
    """Lock the folder beside the film `out`, remove incomplete parts and parts of other films, and yield the folder.

    Raises UsageError if the folder cannot be written, or another process makes this film.
    """
    if out.is_dir():
        raise UsageError(f"--out {out} is a folder. Name a file in it")
    folder, failure = folder_beside(out), f"--out {out} cannot be written"
    with file_errors_as(UsageError, failure):
        folder.mkdir(parents=True, exist_ok=True)
        lock: IO[str] = (folder / LOCK).open("w")
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UsageError(f"another process is making {out}. Wait for it, or choose another --out") from None
        with file_errors_as(UsageError, failure):
            manifest = {"film": plan.digest(codec), "codec": codec, "pictures": plan.pictures}
            before = json_object(folder / MANIFEST)
            for path in folder.iterdir():
                if path.name not in (LOCK, MANIFEST) and (before != manifest or MAKING in path.name):
                    path.unlink()
            write_json(folder / MANIFEST, manifest)
        yield PartsFolder(folder, plan, codec)


def codec_for(out: Path) -> Codec:
    """Return the codec of a film, which depends on the file's suffix and the installed encoders."""
    if out.suffix.lower() == ".gif":
        return "gif"
    return "h264" if ffmpeg() else "mp4v"


def describe_codec(codec: Codec) -> str:
    """Return a phrase that names a codec and its encoder."""
    if codec == "h264":
        return "H.264 (ffmpeg of imageio-ffmpeg)"
    if codec == "gif":
        return f"GIF of {GIF_COLORS} colours, by Pillow"
    return f"MPEG-4 part 2 (OpenCV), which browsers do not play. For H.264: {not_installed('imageio_ffmpeg')}"


def ffmpeg() -> str | None:
    """Return the path of the ffmpeg of imageio-ffmpeg; None if it is not installed."""
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
    # without B-frames, a part's timestamps begin at its first picture, so parts join without new timestamps
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
            pass  # ffmpeg ended; its output has the reason
        except BaseException:
            process.kill()
            raise
        words = process.stderr.read().decode(errors="replace")
        if process.wait() != 0:
            raise _failed(words)


def _failed(words: str) -> InfrastructureError:
    return InfrastructureError(f"ffmpeg failed: {(words.strip().splitlines() or ['no output'])[-1][:200]}")


def join(paths: Sequence[Path], out: Path, plan: FilmPlan, codec: Codec) -> None:
    """Write the film from its parts. Raises InfrastructureError when the encoder fails."""
    if codec == "h264":
        _join_h264(paths, out)
    elif codec == "gif":
        _join_gif(paths, out, plan)
    else:
        writer = cv2.VideoWriter(str(out), cv2.VideoWriter.fourcc(*"mp4v"), float(plan.fps), (plan.width, plan.height))
        if not writer.isOpened():
            raise InfrastructureError(f"OpenCV has no encoder for films, and {not_installed('imageio_ffmpeg')}")
        for picture in _read(paths):
            writer.write(picture)
        writer.release()


def _join_h264(paths: Sequence[Path], out: Path) -> None:
    listed = out.with_name(out.name + ".txt")
    quoted = (str(path.resolve()).replace("'", "'\\''") for path in paths)
    listed.write_text("".join(f"file '{name}'\n" for name in quoted), encoding="utf-8")
    command = [str(ffmpeg()), "-y", "-loglevel", "error", "-f", "concat", "-safe", "0", "-i", str(listed), "-c", "copy",
               "-movflags", "+faststart", "-f", "mp4", str(out)]  # fmt: skip
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    listed.unlink()
    if done.returncode != 0:
        raise _failed(done.stderr)


def _read(paths: Sequence[Path], every: int = 1) -> Iterator[Picture]:
    """Yield the pictures of parts, (H, W, 3) BGR."""
    number = 0
    for path in paths:
        reader = cv2.VideoCapture(str(path))
        while True:
            more, picture = reader.read()
            if not more:
                break
            if number % every == 0:
                yield np.asarray(picture, np.uint8)
            number += 1
        reader.release()


def _join_gif(paths: Sequence[Path], out: Path, plan: FilmPlan) -> None:
    palette = _palette(list(_read(paths, max(1, plan.pictures // GIF_SAMPLED))))
    shown: Picture | None = None

    def pictures() -> Iterator[Any]:
        nonlocal shown
        for bgr in _read(paths):
            rgb = bgr[..., ::-1]
            if shown is None:
                shown = rgb.copy()
            else:
                moved = (cv2.absdiff(shown, np.ascontiguousarray(rgb)) >= GIF_STILL).any(axis=2)
                shown[moved] = rgb[moved]
            yield Image.fromarray(shown).quantize(palette=palette, dither=Image.Dither.NONE)

    frames = pictures()
    first = next(frames)
    times_cs = [round(100 * k / plan.fps) for k in range(plan.pictures + 1)]  # a GIF counts hundredths of a second
    durations_ms = [10 * (end - begin) for begin, end in itertools.pairwise(times_cs)]
    first.save(
        out, "GIF", save_all=True, append_images=frames, duration=durations_ms, loop=0, optimize=False, disposal=1
    )


def _palette(samples: Sequence[Picture]) -> Any:
    """Return a picture whose palette fits all samples and contains MARKS."""
    width = max(1, samples[0].shape[1] // 2)
    height = max(1, samples[0].shape[0] // 2)
    small = [cv2.resize(sample, (width, height), interpolation=cv2.INTER_NEAREST) for sample in samples]
    together = np.ascontiguousarray(np.concatenate(small)[..., ::-1])
    quantized = Image.fromarray(together).quantize(GIF_COLORS - len(MARKS), method=Image.Quantize.MEDIANCUT)
    colors = [*(quantized.getpalette() or [])[: 3 * (GIF_COLORS - len(MARKS))], *itertools.chain(*MARKS)]
    palette = Image.new("P", (1, 1))
    palette.putpalette(colors)
    return palette
