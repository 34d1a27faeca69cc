"""The vision pilot: classical vision, not a model.

The pilot uses the picture, the prompt and assumed knowledge: a level pinhole camera, 90° across (paper, appendix
"Execution"), the usual sizes and colours of things, and how the agent flies a `go`. It does not know true positions,
has no map and no memory, and reads its past actions in the prompt's history, so equal requests get equal answers.
Depending on the command, it looks for the target by an inscription, by colour, or by its place beside a landmark. It
cannot read the names on halls.
"""

import cv2
import numpy as np

from dronecats.pilots import actions
from dronecats.pilots.vision import color_target, colors, inscription_target, place_target
from dronecats.pilots.vision.command import read_inscription, read_place_expression, read_referent
from foundation.errors import UsageError

_WIDTH = 640  # px, width of the agent's pictures; thresholds in pixels are for this width


def answer(prompt: str, images: list[bytes]) -> str:
    """Return the next action of every picture's drone. Raises UsageError without pictures or for a broken picture."""
    if not images:
        raise UsageError("The vision pilot needs a picture.")
    briefing = actions.read_prompt(prompt)
    command, histories = briefing.command, [briefing.past(k) for k in range(len(images))]
    pictures = [decode(jpeg) for jpeg in images]
    inscription = read_inscription(command)
    if inscription is not None:
        return actions.join(inscription_target.decide(pictures, inscription, command, histories))
    referent = read_referent(command)
    expression = read_place_expression(command) if referent.color is None else None
    views = zip(pictures, histories, strict=True)
    if expression is not None:
        return actions.join([place_target.decide(picture, expression, past) for picture, past in views])
    return actions.join([color_target.decide(picture, referent, past) for picture, past in views])


def decode(jpeg: bytes) -> colors.Picture:
    """Return the picture (H, W, 3) in BGR, at most 640 px wide. Raises UsageError for a broken or tiny picture."""
    data = np.frombuffer(jpeg, np.uint8)
    picture = None
    if len(data):
        try:
            picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
        except cv2.error:
            picture = None
    if picture is None or min(picture.shape[:2]) < 16:
        raise UsageError("The picture cannot be decoded, or is smaller than 16 pixels.")
    height, width = picture.shape[:2]
    if width > _WIDTH:
        picture = cv2.resize(picture, (_WIDTH, max(16, round(height * _WIDTH / width))), interpolation=cv2.INTER_AREA)
    return np.asarray(picture, np.uint8)
