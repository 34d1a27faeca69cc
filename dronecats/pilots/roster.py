"""Creates the built-in pilots by name, and tells what each pilot needs."""

from collections.abc import Iterable
from pathlib import Path

from dronecats.pilots import scripted
from dronecats.pilots.actions import Pilot
from dronecats.pilots.oracle.failing import FAILURES
from dronecats.pilots.scripted import PATTERNS
from dronecats.pilots.vision.command import read_inscription
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.wording import suggestion

SERVED = {"vision": "dronecats (classical vision, not a model)", "blind": "dronecats (sees nothing, not a model)"}
RECORDED, BLIND, FAILING = "recorded:", "blind:", "failing:"  # prefixes of pilot names
ORACLE, NOISY = "oracle", "noisy"
NAMES = (*SERVED, ORACLE, NOISY)
COMMANDERS = {"scripted:divide": "dronecats (a script that divides, not a model)"}


def check(name: str) -> str:
    """Return `name` if it names a pilot.

    Raises UsageError (with similar names) for an unknown name, or for a recording without replies.
    """
    if name in NAMES:
        return name
    for prefix, kinds in ((BLIND, PATTERNS), (FAILING, FAILURES)):
        if name.startswith(prefix):
            if name.removeprefix(prefix) in kinds:
                return name
            # the cutoff is high, because the common prefix makes all names similar
            hint = suggestion(name, [f"{prefix}{kind}" for kind in kinds], count=2, cutoff=0.8)
            raise UsageError(f"pilot '{name}' is not known: {hint}")
    if name.startswith(RECORDED):
        answer(name)
        return name
    all_names = (*NAMES, f"{BLIND}NAME", f"{FAILING}NAME", f"{RECORDED}FILE")
    raise UsageError(f"pilot '{name}' is not known: {suggestion(name, all_names, count=2)}")


def check_installed(name: str, instructions: Iterable[str]) -> None:
    """Raise UsageError if a pilot needs a missing package for one of these instructions."""
    if name == "vision" and any(map(read_inscription, instructions)):
        from dronecats.pilots.vision import ocr

        ocr.check_installed()


def check_camera(name: str | None, camera: CameraModel) -> None:
    """Raise UsageError if a pilot cannot use a camera. For vision, the size of the pictures must be the benchmark's."""
    size, needed = (camera.width, camera.height), (CameraModel().width, CameraModel().height)
    if name == "vision" and size != needed:
        raise UsageError(
            f"the pilot vision needs pictures of {needed[0]}×{needed[1]} px, and this camera gives {size[0]}×{size[1]}."
            " Set the camera to this size, for example with --camera v4l2:0?size=1280x720, or choose --model"
        )


def check_commander(name: str) -> str:
    """Return `name` if it names a built-in commander. Raises UsageError for another name."""
    if name in COMMANDERS:
        return name
    raise UsageError(f"commander '{name}' is not known: choose PROVIDER/NAME or {', '.join(COMMANDERS)}")


def can_serve_several_drones(name: str) -> bool:
    """Return whether one instance of the pilot can fly several drones with a separate request for each drone."""
    return name in NAMES


def needs_pictures(name: str) -> bool:
    return not needs_truth(name) and name != "blind" and not name.startswith(BLIND)


def needs_truth(name: str | None) -> bool:
    """Return whether a pilot needs the truth. It then flies only in worlds that provide the truth."""
    return name is not None and (name in (ORACLE, NOISY) or name.startswith(FAILING))


def answer(name: str) -> Pilot:
    """Return the pilot that an endpoint (`PilotServer`) serves. Raises UsageError for a recording without replies."""
    if name.startswith(RECORDED):
        return scripted.player(Path(name.removeprefix(RECORDED)))
    if name in COMMANDERS:
        return scripted.scripted_orders
    if name == "vision":
        from dronecats.pilots.vision.pilot import answer as vision

        return vision
    return scripted.pattern_pilot(name.removeprefix(BLIND)) if name.startswith(BLIND) else scripted.answer


def owner(name: str) -> str:
    """Return the text that a pilot's endpoint shows as the owner of the pilot, in the list of models."""
    if name.startswith(BLIND):
        return f"{SERVED['blind'][:-1]}: {PATTERNS[name.removeprefix(BLIND)].description})"
    return (SERVED | COMMANDERS).get(name, "dronecats (repeats the replies of another flight, not a model)")
