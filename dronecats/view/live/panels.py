"""The panels of a live page or replay: pictures, replies, vehicle states, and (if chosen) the judge's data."""

import base64
import json
import math
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import viser
from msgspec import UNSET

from dronecats.report.kit.palette import DARK, LIGHT, MARKS
from dronecats.view.live.moment import DroneMoment, JudgeMoment, Moment, ShownPicture, chosen_go
from dronecats.view.scene.page import by_user
from foundation.protocol import POINT_SPAN
from foundation.run_folder.rows import Decision, drone_label

NO_DRONE = "nobody"
WIDTH_PX, FLEET_PX = 400, 520  # width of the picture panel for one drone, for several drones


class FlightPanels:
    """Shows moments of one flight. All text from models, autopilots and users is escaped."""

    def __init__(
        self,
        server: viser.ViserServer,
        drones: int,
        *,
        piloted: bool = True,
        on_judge: Callable[[bool], None] = lambda shown: None,
        on_follow: Callable[[int | None], None] = lambda drone: None,
    ) -> None:
        """`piloted`: show the panels of pictures and replies.

        `on_judge` and `on_follow` are called when a user chooses the judge's view, or a drone to follow.
        """
        self._server, self._drones = server, drones
        self.judge_shown = False
        gui = server.gui
        self._pictures = gui.add_panel() if piloted else None
        self._shown: list[tuple[ShownPicture | None, Decision | None]] = []  # per drone, as in `newest_decided`
        self._frames = self._add_frames(self._pictures) if self._pictures is not None else None
        self._folder = gui.add_folder("Flight")
        with self._folder:
            self._state = gui.add_html("")
            choices: dict[str, int | None] = {NO_DRONE: None, **{drone_label(k): k for k in range(drones)}}
            self._follow: Any = gui.add_dropdown("Follow", tuple(choices), initial_value=NO_DRONE)
            self._judge: Any = gui.add_checkbox("The judge's view", False)
            self._judged = gui.add_html("")
            self._pilots = gui.add_html("", visible=piloted)
            self._numbers = gui.add_html("")
            self._messages = gui.add_html("")

        def show_judge() -> None:
            self.judge_shown = bool(self._judge.value)
            on_judge(self.judge_shown)

        self._follow.on_update(by_user(lambda: on_follow(choices[self._follow.value])))
        self._judge.on_update(by_user(show_judge))

    def _add_frames(self, panel: Any) -> Any:
        """Add an HTML element for the pictures to a panel, and return the element."""
        single = self._drones == 1
        self.pictures = panel.add_tab("What the pilot saw" if single else "What the pilots saw", viser.Icon.CAMERA)
        with self.pictures:
            frames = self._server.gui.add_html("")
        panel.dock_left()
        panel.set_width(WIDTH_PX if single else FLEET_PX)
        return frames

    def show(self, moment: Moment) -> None:
        """Show a moment. viser sends only the changed texts."""
        with self._server.atomic():
            self._state.content = state_html(moment)
            drones = moment.drones[: self._drones]
            if self._frames is not None:
                shown = [newest_decided(drone) for drone in drones]
                if shown != self._shown:  # encoding large pictures takes a while
                    self._shown, self._frames.content = shown, frames_html(drones)
                self._pilots.content = decisions_html(drones)
            self._numbers.content = numbers_html(drones)
            self._messages.content = messages_html(moment.drones)
            self._judged.content = judge_html(moment.judge) if self.judge_shown else ""
        self._server.flush()

    def show_wanted(self, judge: bool, followed: int | None) -> None:
        """Show choices made with another control, such as a key. Calls neither `on_judge` nor `on_follow`."""
        self.judge_shown = judge
        self._judge.value = judge
        self._follow.value = NO_DRONE if followed is None else drone_label(followed)

    def remove(self) -> None:
        if self._pictures is not None:
            self._pictures.remove()
        self._folder.remove()


YELLOW, ACCENT, JUDGE = MARKS["chosen"], LIGHT["accent"], LIGHT["judge-line"]
MESSAGES, FLEETS_MESSAGES = 6, 3  # newest messages shown per drone
HEADS = ("speed", "height", "battery", "mode")
WIDE, HIGH = 1280, 720  # SVG units of a drawing over a picture; the picture may have another size
NO_PICTURE = (
    f'<div style="aspect-ratio:{WIDE}/{HIGH};background:{DARK["panel"]};color:{DARK["quiet"]};display:flex;'
    'align-items:center;justify-content:center;font-size:12px">no picture yet</div>'
)


def frame_html(drone: DroneMoment, label: str) -> str:
    """Return a drone's newest picture as HTML. If a decision was made on it, the decision's point is marked."""
    picture, decision = newest_decided(drone)
    if picture is None:
        body = NO_PICTURE
    else:
        ring = _ring_svg(decision) if decision is not None else ""
        data = base64.b64encode(picture.jpeg).decode()
        body = (
            f'<div class="frame" data-drone="{drone.drone}" data-frame="{picture.frame_id}" '
            f'style="position:relative"><img alt="" style="display:block;width:100%;border-radius:4px" '
            f'src="data:image/jpeg;base64,{data}"/>{ring}</div>'
        )
    taken = f" at {picture.t_s:.1f} s" if picture is not None and picture.t_s is not None else ""
    return f'<div style="padding:2px 10px 4px">{_small(escape(label) + taken)}{body}</div>'


def frames_html(drones: Sequence[DroneMoment]) -> str:
    """Return the pictures of all drones as HTML. A fleet has two columns."""
    if len(drones) == 1:
        return frame_html(drones[0], "the picture of the question")
    cells = "".join(f"<div>{frame_html(drone, drone_label(drone.drone))}</div>" for drone in drones)
    return f'<div style="display:grid;grid-template-columns:1fr 1fr">{cells}</div>'


def newest_decided(drone: DroneMoment) -> tuple[ShownPicture | None, Decision | None]:
    """Return the picture to show of a drone, and the decision whose point is marked in it, if any."""
    newer = drone.picture is not None and (
        drone.decided_on is None or drone.picture.frame_id > drone.decided_on.frame_id
    )
    return (drone.picture, None) if newer else (drone.decided_on, drone.decision)


def decisions_html(drones: Sequence[DroneMoment]) -> str:
    """Return the newest prompts, replies and actions as HTML. A reply for several drones appears once."""
    if len(drones) == 1:
        return decision_html(drones[0])
    html = ""
    replies: dict[tuple[int, str], list[DroneMoment]] = {}  # (step, reply) → drones with this reply
    for drone in drones:
        if (decision := drone.decision) is not None:
            replies.setdefault((decision.step, str(decision.reply)), []).append(drone)
    for drone in drones:
        decision = drone.decision
        words = "no decision yet" if decision is None else decision.action_or_reason()
        html += (
            f'<div class="action" data-drone="{drone.drone}" style="font-size:13px;font-weight:600;color:{ACCENT};'
            f'padding:3px 10px 0"><span style="opacity:0.65">{drone_label(drone.drone)}</span> {escape(words)}</div>'
        )
        if decision is not None and len(replies[decision.step, str(decision.reply)]) == 1:
            html += _box(_reply_html(drone, decision))
    for _, (first, *rest) in sorted(replies.items()):
        if rest and first.decision is not None:
            html += _box(_reply_html(first, first.decision))
    return html


def decision_html(drone: DroneMoment) -> str:
    """Return the newest prompt, reply and action of a drone as HTML."""
    decision = drone.decision
    if decision is None:
        return _box(_small("no decision yet"))
    return _box(
        f'<div class="action" data-step="{decision.step}" style="font-size:14px;font-weight:600;color:{ACCENT};'
        f'margin:2px 0 4px">{escape(decision.action_or_reason())}</div>' + _reply_html(drone, decision)
    )


def _reply_html(drone: DroneMoment, decision: Decision) -> str:
    """Return a reply, its cost and its prompt as HTML."""
    took = "" if decision.latency_s is None else f"{decision.latency_s:.2f} s"
    rate = "" if decision.rate_hz is None else f"{decision.rate_hz:.2f} a second"
    rows = [("step", str(decision.step)), ("latency", took), ("decisions", rate), ("tokens", _tokens(decision))]
    prompt = ""
    if drone.prompt:
        summary = '<summary style="cursor:pointer;opacity:0.65">prompt</summary>'
        prompt = f"<details>{summary}{_quoted(drone.prompt)}</details>"
    reply = _quoted("" if decision.reply is UNSET else str(decision.reply))
    return _small("reply") + f'<div class="reply">{reply}</div>' + _pairs([row for row in rows if row[1]]) + prompt


def numbers_html(drones: Sequence[DroneMoment]) -> str:
    """Return speed, height, battery and mode as HTML. A fleet has one line per drone."""
    if len(drones) == 1:
        return _box(_pairs([row for row in _numbers(drones[0]) if row[1]]))
    head = "".join(f'<th style="font-weight:400;opacity:0.65">{name}</th>' for name in ("", *HEADS))
    lines = "".join(
        f"<tr><td>{drone_label(drone.drone)}</td>"
        + "".join(
            f'<td style="text-align:center"><b>{escape(value)}</b></td>' for _, value in _numbers(drone, brief=True)
        )
        + "</tr>"
        for drone in drones
    )
    return _box(f'<table style="width:100%;font-size:11px"><tr>{head}</tr>{lines}</table>')


def _numbers(drone: DroneMoment, *, brief: bool = False) -> list[tuple[str, str]]:
    speed = None if drone.velocity_ned is None else math.hypot(*drone.velocity_ned)
    setpoint = None if drone.setpoint_ned is None else math.hypot(*drone.setpoint_ned)
    mode = drone.mode + ("" if drone.armed is None or brief else " · armed" if drone.armed else " · disarmed")
    commanded = "" if setpoint is None or brief else f" (commanded {setpoint:.1f})"
    rows = [
        ("speed", "" if speed is None else f"{speed:.1f} m/s{commanded}"),
        ("height", "" if drone.height_m is None else f"{drone.height_m:.1f} m"),
        ("battery", "" if drone.battery is None else f"{100 * drone.battery:.0f} %"),
        ("mode", mode.strip(" ·")),
        ("pose", "" if drone.position_ned is None else "truth" if drone.true else "estimate"),
    ]
    return rows[: len(HEADS)] if brief else rows


def messages_html(drones: Sequence[DroneMoment]) -> str:
    """Return the newest messages of each drone as HTML, newest first."""
    several = len(drones) > 1
    most = FLEETS_MESSAGES if several else MESSAGES
    lines = [
        f"{drone_label(drone.drone)}: {message}" if several else message
        for drone in drones
        for message in drone.messages[-most:][::-1]
    ]
    rows = "".join(f'<div style="border-top:1px solid rgba(128,128,128,0.18)">{escape(line)}</div>' for line in lines)
    return _box(_small("messages") + f'<div class="messages">{rows or "none"}</div>')


def state_html(moment: Moment) -> str:
    """Return the clock, the state and the instruction as HTML."""
    instruction = ""
    if moment.instruction:
        instruction = f'<div style="font-size:13px;margin-top:2px"><b>{escape(moment.instruction)}</b></div>'
    return _box(
        f'<div class="state" style="font-size:15px;font-weight:600">{clock(moment.t_s)} '
        f'<span style="font-weight:400;opacity:0.7">{escape(moment.state)}</span></div>{instruction}'
    )


def clock(t_s: float) -> str:
    """Return a time of the episode as text, in tenths of a second; "before the episode" if it has not begun."""
    return f"{t_s:.1f} s" if t_s > 0.0 else "before the episode"


def judge_html(judge: JudgeMoment) -> str:
    """Return the judge's data as HTML: distances to the target, declarations and the verdict."""
    far = [("" if len(judge.distance_m) < 2 else f"{drone_label(k)} ", d) for k, d in enumerate(judge.distance_m)]
    rows = [(f"{drone}to the target", f"{d:.2f} m") for drone, d in far if d is not None]
    lines = "".join(f"<div>{escape(line)}</div>" for line in judge.messages[-MESSAGES:][::-1])
    return (
        f'<div class="judge" style="border-left:3px solid {JUDGE};margin:2px 10px">'
        + _box(_small("known to the judge only") + _pairs(rows) + lines)
        + "</div>"
    )


def _ring_svg(decision: Decision) -> str:
    go = chosen_go(decision)
    if go is None:
        return ""
    x, y = go.x * WIDE / POINT_SPAN, go.y * HIGH / POINT_SPAN
    rings = "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="48" fill="none" stroke="{color}" stroke-width="{width}"/>'
        for color, width in (("#000", 16), (YELLOW, 9))
    )
    return (
        f'<svg class="ring" data-x="{go.x:g}" data-y="{go.y:g}" viewBox="0 0 {WIDE} {HIGH}" '
        'preserveAspectRatio="none" '
        f'style="position:absolute;inset:0;width:100%;height:100%;overflow:hidden">{rings}</svg>'
    )


def _tokens(decision: Decision) -> str:
    if decision.tokens_in is None and decision.tokens_out is None:
        return ""
    return f"{decision.tokens_in or 0} in, {decision.tokens_out or 0} out"


def _quoted(text: str) -> str:
    return (
        '<pre style="white-space:pre-wrap;overflow-wrap:anywhere;font-size:11px;line-height:1.35;margin:2px 0 6px;'
        'padding:5px 7px;max-height:190px;overflow-y:auto;background:rgba(128,128,128,0.12);border-radius:4px">'
        f"{escape(_plain(text))}</pre>"
    )


def _plain(text: str) -> str:
    """Return a JSON object as one line; any other reply unchanged, without surrounding space."""
    try:
        value: Any = json.loads(text)
    except (ValueError, RecursionError):
        return text.strip()
    return json.dumps(value, ensure_ascii=False) if isinstance(value, dict) else text.strip()


def _pairs(rows: Sequence[tuple[str, str]]) -> str:
    return "".join(
        f'<div style="display:flex;justify-content:space-between;gap:10px"><span style="opacity:0.65">{escape(name)}'
        f'</span><b style="text-align:right">{escape(value)}</b></div>'
        for name, value in rows
    )


def _small(text: str) -> str:
    return f'<div style="font-size:11px;opacity:0.65;margin:2px 0">{text}</div>'


def _box(inner: str) -> str:
    return f'<div style="font-size:12px;line-height:1.5;padding:2px 10px 4px">{inner}</div>'
