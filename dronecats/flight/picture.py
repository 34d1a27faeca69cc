"""Draws one picture of a flight: the map from above with all paths, and below it the pilot's images and decisions.

It reads only the files of an episode folder. It leaves out missing data without an error, because the picture is most
useful for flights that failed.
"""

import math
import textwrap
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.verdict import qualifies
from episodes.camera.renderer.renderer import Renderer
from episodes.world.world import World
from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError
from foundation.frames import Vec3, quat_from_euler
from foundation.protocol import POINT_SPAN, RADIUS_M
from foundation.run_folder import layout
from foundation.run_folder.reading import Logs, json_object, truth
from foundation.run_folder.rows import Decision, FrameTruth, Pose, drone_label

Extent = tuple[float, float, float, float]  # m NED: north_min, north_max, east_min, east_max

FRAMES = 8  # images below the map
_COLUMNS = 4
_WIDTH_IN, _MAP_IN, _ROW_IN = 12.8, 8.0, 2.25
_DPI = 100
# colours of the drones' paths, distinct on grass, asphalt and paper, also for most colour-blind readers (Okabe and
# Ito's palette, brightened)
_DRONES = ("#ffb000", "#3fa7ff", "#ff5c8a", "#b48cff", "#00d0a0", "#ff7a1a")
_ACCEPTED, _REJECTED, _TARGET = "#18c93a", "#ff2a2a", "#ff2fd6"
FLIGHT_COLORS = (_DRONES[0], _TARGET, _ACCEPTED)  # drone, target and accepted declaration
_MARGIN_M = 8.0
AERIAL_HFOV_DEG = 20.0  # a narrow view from high above shows little parallax: roofs do not lean off their houses
AERIAL_WIDTH_PX, AERIAL_HEIGHT_PX = 1600, 1000
AERIAL_MARGIN_M = 12.0


def draw(run_episode_dir: Path, map_picture: NDArray[np.uint8], extent: Extent) -> Path:
    """Write `flight.png` in the episode folder and return its path.

    map_picture: (H, W, 3) RGB from above, north up and east right, filling `extent`.
    Raises UsageError when the folder holds no log to draw.
    """
    flight = JudgedFlight.read(run_episode_dir)
    shown = [decision for decision in _select_decisions(flight.logs) if flight.picture_path(decision) is not None]
    rows = math.ceil(len(shown) / _COLUMNS)
    height = _MAP_IN + rows * _ROW_IN + 0.3
    figure = Figure(figsize=(_WIDTH_IN, height), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    above = figure.add_axes((0.06, 1.0 - (_MAP_IN - 0.35) / height, 0.925, (_MAP_IN - 1.0) / height))
    _map(above, flight.logs, map_picture, extent)
    _title(above, flight)
    for place, decision in enumerate(shown):
        column, row = place % _COLUMNS, place // _COLUMNS
        bottom = 1.0 - (_MAP_IN + (row + 1) * _ROW_IN - 0.05) / height
        axes = figure.add_axes((0.01 + column * 0.247, bottom, 0.24, (_ROW_IN - 0.42) / height))
        _frame(axes, flight, decision)
    path = run_episode_dir / layout.PICTURE
    figure.savefig(path, metadata={"Software": None})  # no library version: equal flights give equal files
    return path


def _map(axes: Axes, logs: Logs, picture: NDArray[np.uint8], extent: Extent) -> None:
    poses = sorted(logs.poses, key=lambda p: p.t)
    north_min, north_max, east_min, east_max = extent
    axes.imshow(picture, extent=(east_min, east_max, north_min, north_max), origin="upper", zorder=0)
    axes.set_facecolor(tuple(picture.reshape(-1, 3).mean(axis=0) / 255.0))  # fills the map around the picture
    drones = sorted({p.drone for p in poses})
    for drone in drones:
        _trace(axes, [p for p in poses if p.drone == drone], _DRONES[drone % len(_DRONES)], drone, len(drones) > 1)
    _target(axes, poses)
    _declarations(axes, logs)
    _frame_map(axes, poses, extent)
    _north_arrow(axes)
    _scale_bar(axes)
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left", fontsize=8, framealpha=0.85)


def _trace(axes: Axes, poses: list[Pose], color: str, drone: int, named: bool) -> None:
    north = [p.position_ned[0] for p in poses]
    east = [p.position_ned[1] for p in poses]
    axes.plot(east, north, color="black", linewidth=3.6, alpha=0.5, zorder=3)
    axes.plot(east, north, color=color, linewidth=2.2, zorder=4, label=drone_label(drone) if named else "drone")
    axes.plot(east[0], north[0], "o", color=color, markeredgecolor="black", markersize=10, zorder=6)
    axes.plot(east[-1], north[-1], "s", color=color, markeredgecolor="black", markersize=8, zorder=6)
    yaw = math.radians(poses[0].yaw_deg or 0.0)
    axes.annotate(
        "",
        xy=(east[0] + 2.2 * math.sin(yaw), north[0] + 2.2 * math.cos(yaw)),
        xytext=(east[0], north[0]),
        arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 2.0},
        zorder=6,
    )


def _target(axes: Axes, poses: list[Pose]) -> None:
    places = [p.target_ned for p in poses if p.target_ned]
    if not places:
        return
    first, last = places[0], places[-1]
    if math.dist(first, last) > 0.2 or any(math.dist(first, p) > 0.2 for p in places):
        axes.plot([p[1] for p in places], [p[0] for p in places], "--", color=_TARGET, linewidth=1.8, zorder=3)
        axes.plot(first[1], first[0], "D", markerfacecolor="none", color=_TARGET, markersize=7, zorder=5)
    axes.plot(last[1], last[0], "D", color=_TARGET, markeredgecolor="white", markersize=9, zorder=5, label="target")
    ring = Circle(
        (last[1], last[0]), RADIUS_M, fill=False, color=_TARGET, linewidth=1.6, linestyle=(0, (5, 3)), zorder=4
    )
    axes.add_patch(ring)


def _declarations(axes: Axes, logs: Logs) -> None:
    labels = {True: "declaration within reach", False: "declaration rejected"}
    for decision in logs.decisions:
        good, frame = qualifies(decision, logs), logs.frames.get((decision.drone, decision.frame_id))
        if good is None or frame is None or frame.position_ned is None:
            continue
        north, east = frame.position_ned[:2]
        if good:
            axes.plot(east, north, "*", color=_ACCEPTED, markeredgecolor="black", markersize=19, zorder=8,
                      label=labels.pop(True, None))  # fmt: skip
        else:
            axes.plot(east, north, "x", color=_REJECTED, markeredgewidth=3, markersize=9, zorder=7,
                      label=labels.pop(False, None))  # fmt: skip


def _frame_map(axes: Axes, poses: list[Pose], extent: Extent) -> None:
    """Fit the axes to all positions and a margin; if there are no positions, to `extent`."""
    points: list[Vec3] = [p.position_ned for p in poses] + [p.target_ned for p in poses if p.target_ned]
    box = axes.get_window_extent()
    shape = box.width / box.height
    if points:
        north, east = np.array([p[:2] for p in points], float).T
        middle = (0.5 * (north.min() + north.max()), 0.5 * (east.min() + east.max()))
        high = max(float(np.ptp(north)) + 2.0 * _MARGIN_M, (float(np.ptp(east)) + 2.0 * _MARGIN_M) / shape, 20.0)
    else:
        middle = (0.5 * (extent[0] + extent[1]), 0.5 * (extent[2] + extent[3]))
        high = extent[1] - extent[0]
    axes.set_aspect("equal", adjustable="box")
    axes.set_ylim(middle[0] - 0.5 * high, middle[0] + 0.5 * high)
    axes.set_xlim(middle[1] - 0.5 * high * shape, middle[1] + 0.5 * high * shape)


def _north_arrow(axes: Axes) -> None:
    arrow = {"arrowstyle": "-|>", "linewidth": 2.5, "color": "black"}
    plate = {"boxstyle": "round,pad=0.3", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
    axes.annotate(
        "N", xy=(0.965, 0.97), xytext=(0.965, 0.85), xycoords="axes fraction", ha="center", fontsize=13,
        fontweight="bold", arrowprops=arrow, bbox=plate, zorder=10,
    )  # fmt: skip


def _scale_bar(axes: Axes) -> None:
    west, east = axes.get_xlim()
    south, north = axes.get_ylim()
    length = next(s for s in (100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0) if s <= 0.3 * (east - west) or s == 1.0)
    right, low = east - 0.025 * (east - west), south + 0.05 * (north - south)
    tall = 0.012 * (north - south)
    pad = 0.01 * (east - west)
    axes.add_patch(
        Rectangle(
            (right - length - pad, low - 2.2 * tall), length + 2 * pad, 7.5 * tall, color="white", alpha=0.8, zorder=9
        )
    )
    for half, color in ((0, "black"), (1, "#bbbbbb")):
        axes.add_patch(
            Rectangle((right - length + half * length / 2, low - tall), length / 2, tall, color=color, zorder=10)
        )
    axes.text(right - length / 2, low + 0.6 * tall, f"{length:g} m", ha="center", va="bottom", fontsize=10, zorder=10)


def _title(axes: Axes, flight: JudgedFlight) -> None:
    verdict = json_object(flight.folder / layout.VERDICT) or {}
    outcome = str(verdict.get("outcome", "not judged"))
    facts = [outcome.upper()]
    if isinstance(verdict.get("ne_m"), int | float):
        facts.append(f"{verdict['ne_m']:.2f} m from the target")
    deciding = verdict.get("deciding")
    if isinstance(deciding, dict) and isinstance(deciding.get("t"), int | float):
        facts.append(f"declared at {deciding['t']:.0f} s")
    if isinstance(verdict.get("steps"), int):
        facts.append(f"{verdict['steps']} steps")
    color = {"success": "#0b7a22", "failure": "#b01010"}.get(outcome, "#555555")
    instruction = str(flight.record.get("instruction", ""))
    headline = f"{flight.id}: “{instruction}”" if instruction else flight.id
    axes.text(0.0, 1.055, textwrap.shorten(headline, 110, placeholder=" …"), transform=axes.transAxes, fontsize=14,
              fontweight="bold", va="bottom", parse_math=False)  # fmt: skip
    axes.text(0.0, 1.015, textwrap.shorten(" · ".join(facts), 130, placeholder=" …"), transform=axes.transAxes,
              fontsize=12, color=color, va="bottom", parse_math=False)  # fmt: skip


def _frame(axes: Axes, flight: JudgedFlight, decision: Decision) -> None:
    path = flight.picture_path(decision)
    picture = None if path is None else cv2.imread(str(path), cv2.IMREAD_COLOR)
    axes.set_axis_off()
    if picture is None:  # the file is missing or damaged
        axes.text(0.5, 0.5, "no picture", ha="center", va="center", transform=axes.transAxes, color="#777777")
    else:
        height, width = picture.shape[:2]
        axes.imshow(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
        if (go := decision.go) is not None:
            x, y = go.x * width / POINT_SPAN, go.y * height / POINT_SPAN
            for size, color in ((5.0, "black"), (2.5, "#ffe600")):
                axes.plot(x, y, "o", markersize=17, markerfacecolor="none", markeredgecolor=color, markeredgewidth=size)
        axes.set_xlim(0, width)
        axes.set_ylim(height, 0)
    drone = f" {drone_label(decision.drone)}" if any(d.drone for d in flight.logs.decisions) else ""
    good = qualifies(decision, flight.logs)
    color = {True: "#0b7a22", False: _REJECTED, None: "black"}[good]
    caption = f"{decision.step}{drone}  {decision.t_frame:.0f} s  {decision.action_or_reason(30)}"
    axes.set_title(caption, fontsize=9, pad=3, color=color, loc="left", parse_math=False)


def _select_decisions(logs: Logs) -> list[Decision]:
    """Return up to FRAMES decisions: first, last, the first accepted declaration, and others in between.

    For a fleet, the decisions of all drones at a step are shown if they fit, so that their views can be compared.
    """
    steps: dict[int, list[Decision]] = {}
    for decision in logs.decisions:
        steps.setdefault(decision.step, []).append(decision)
    order = sorted(steps)
    wanted = max(1, FRAMES // max((len(drones) for drones in steps.values()), default=1))
    if len(order) <= wanted or wanted == 1:
        return [d for step in order[-wanted:] for d in steps[step]][:FRAMES]
    places = [round(i * (len(order) - 1) / (wanted - 1)) for i in range(wanted)]
    decisive = next((i for i, step in enumerate(order) if any(qualifies(d, logs) for d in steps[step])), None)
    if decisive is not None and decisive not in places:
        # the decisive step replaces the nearest step between first and last, or the last if only two are shown
        nearest = min(range(1, max(2, wanted - 1)), key=lambda k: abs(places[k] - decisive))
        places[nearest] = decisive
    return [d for place in sorted(set(places)) for d in steps[order[place]]]


def aerial(world: World, folder: Path) -> tuple[NDArray[np.uint8], Extent]:
    """Return (picture, extent): RGB (H, W, 3) from above, north up; covers the logged positions, starts and target."""
    points = _logged_positions(folder)
    points += [start.position_ned for start in world.record.starts] + [world.target_centre(0.0)]
    norths, easts = [p[0] for p in points], [p[1] for p in points]
    north, east = (min(norths) + max(norths)) / 2, (min(easts) + max(easts)) / 2
    high = (max(norths) - min(norths)) / 2 + AERIAL_MARGIN_M  # m, half the picture's height on the ground
    wide = max(high * AERIAL_WIDTH_PX / AERIAL_HEIGHT_PX, (max(easts) - min(easts)) / 2 + AERIAL_MARGIN_M)
    high = wide * AERIAL_HEIGHT_PX / AERIAL_WIDTH_PX
    camera = CameraModel(AERIAL_WIDTH_PX, AERIAL_HEIGHT_PX, AERIAL_HFOV_DEG, (0.0, 0.0, 0.0))
    height = wide / math.tan(math.radians(AERIAL_HFOV_DEG / 2))
    ground = world.ground_down(north, east)
    pose = CameraPose((north, east, ground - height), quat_from_euler(0.0, -math.pi / 2, 0.0))
    view = Renderer(world.scene, camera).render(pose, world.moved(0.0))
    return view.rgb, (north - high, north + high, east - wide, east + wide)


def _logged_positions(folder: Path) -> list[Vec3]:
    """Return the positions (m NED) of drones and target in truth.jsonl; none if it is damaged."""
    try:
        rows = [row for row in truth(folder) if isinstance(row, Pose | FrameTruth)]
    except UsageError:
        return []
    return [place for row in rows for place in (row.position_ned, row.target_ned) if place]
