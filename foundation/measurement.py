"""A true measurement of the target from one drone at one time. The logger writes it, and the judge reads it.

`World.measure`, the rows of truth.jsonl and their published schema all use the fields that are declared here.
"""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from foundation.typed_file import LARGE, Number

# `wrong`: the log reader's message about an invalid value
Distance = Annotated[float, Meta(ge=0.0, lt=LARGE, extra={"wrong": "is not a distance"})]
Place = Annotated[tuple[Number, Number, Number], Meta(extra={"wrong": "is not three numbers"})]  # north, east, down
InPicture = Annotated[tuple[Number, Number, Number, Number], Meta(extra={"wrong": "is not four numbers"})]
Visible = Annotated[bool | None, Meta(description="whether the target is in view; null: not measured",
                                      extra={"wrong": "is neither true nor false"})]  # fmt: skip


def doc(description: str) -> Meta:
    """Return the description of a field, for the published schema."""
    return Meta(description=description)


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetMeasurement:
    """The target as one drone and its camera see it. None: not measured, for example missing in an older log."""

    target_ned: Annotated[Place | None, doc("m, NED, position of the target's centre")] = None
    distance_m: Annotated[Distance | None, doc("m, from the body to the target's centre, in three dimensions")]
    distance_box_m: Annotated[Distance | None, doc("m, from the body to the nearest point of the target's box")] = None
    visible: Visible
    visible_fraction: Annotated[Number | None, doc("visible share of the target's silhouette")] = None
    bearing_deg: Annotated[Number | None, doc("°, from the nose to the target's centre, + right")] = None
    oracle_depth_m: Annotated[
        Number | None, doc("m along the optical axis, median over the target's visible surface; null: not visible")
    ] = None
    target_frd: Annotated[
        Place | None, doc("m, from the optical centre to the target's centre: forward, right, down of the camera")
    ] = None
    target_box: Annotated[
        InPicture | None,
        doc("x0, y0, x1, y1 on 0 … 1000: the target's box in the picture, hidden parts too; null: outside"),
    ] = None
