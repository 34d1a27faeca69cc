"""Follows the folder of a flight while it is written, and returns the flight's current state as a Moment."""

import contextlib
import json
import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

from msgspec import UNSET

from dronecats.view.live.folder import FrameTail, LineTail, PictureTail, load_camera
from dronecats.view.live.moment import ChosenSight, DroneMoment, JudgeMoment, Moment, ShownPicture, chosen_go, sight
from dronecats.view.live.wire_state import WireState
from episodes.world.world import World
from foundation.errors import UsageError
from foundation.frames import Vec3
from foundation.run_folder import layout
from foundation.run_folder.prompts import PromptReader
from foundation.run_folder.reading import Row, json_object, parse_row
from foundation.run_folder.rows import (
    TRUTH_ROWS,
    ActiveLimits,
    Begin,
    Decision,
    End,
    EnvelopeRow,
    Exchange,
    FrameTruth,
    LoggedPrompt,
    Pose,
    drone_label,
)

MESSAGES = 20  # number of messages kept per drone


class FlightFollower:
    """Follows one episode folder. `turn` does not block."""

    def __init__(self, folder: Path, world: World | None, drones: int) -> None:
        """`world`: the flight's world, None if it is unknown; `drones`: number of drones."""
        self.folder, self._world, self._drones = folder, world, drones
        scene = world.scene if world is not None else None
        origin = (scene.latitude_deg, scene.longitude_deg, scene.altitude_m) if scene is not None else None
        self._camera = load_camera(folder)
        self._instruction = str((json_object(folder / layout.EPISODE) or {}).get("instruction") or "")
        self._wires = WireState(origin)
        self._tlog = FrameTail(folder / layout.TLOG)
        self._logs = {name: LineTail(folder / name) for name in
                      (layout.TRUTH, layout.PROMPTS, layout.DECISIONS, layout.SAFETY, layout.COMMANDER)}  # fmt: skip
        self._pictures = PictureTail(folder / layout.FRAMES)
        self._begin: Begin | None = None
        self._end: End | None = None
        self._frames: dict[tuple[int, int], FrameTruth] = {}
        self._decisions: dict[int, Decision] = {}  # the newest decision of each drone
        self._reader = PromptReader()
        self._texts: dict[int, list[str]] = defaultdict(list)  # first drone of a question → prompts not yet answered
        self._prompts: dict[int, str] = {}  # drone → the prompt of its newest decision
        self._sights: dict[int, tuple[int, ChosenSight]] = {}  # drone → step and ray of its newest `go` action
        self._rate_hz: float | None = None
        self._messages: dict[int, list[tuple[int, str]]] = defaultdict(list)  # drone → (vehicle time in µs, text)
        self._active = ActiveLimits()
        self._limited: Counter[tuple[int, str]] = Counter()  # (drone, text) → number of messages on safety limits
        self._judge_messages: list[str] = []
        self._verdict: str | None = None
        self.trails: dict[int, list[Vec3]] = defaultdict(list)  # drone → true positions, m, NED, at 2 Hz

    def turn(self) -> Moment:
        """Read the new lines and frames, and return the current moment."""
        self._wires.feed(self._tlog.read())
        for value in self._values(layout.TRUTH):
            self._take_truth(value)
        for row in self._rows(layout.SAFETY, EnvelopeRow):
            if begun := self._active.begun(row):
                self._add_limited(row.drone, row.time_us, f"envelope: limited by {', '.join(begun)}")
        for exchange in self._rows(layout.COMMANDER, Exchange):
            if exchange.t_answered is not None:
                for order in exchange.orders:
                    self._add_message(order.drone, self._us(exchange.t_answered), f"commander: {order.goal}")
        for prompt in self._rows(layout.PROMPTS, LoggedPrompt):
            self._take_prompt(prompt)
        self._take_decisions(self._rows(layout.DECISIONS, Decision))
        self._read_verdict()
        t_s = self._t(self._wires.time_us) if self._begin is not None else 0.0
        if self._end is not None:
            t_s = self._end.t
        drones = tuple(self._drone(k) for k in range(self._drones))
        return Moment(
            t_s=t_s,
            drones=drones,
            judge=self._judge_at(t_s, drones),
            moved=self._world.moved(max(0.0, t_s)) if self._world is not None else {},
            state=self._state(drones),
            rate_hz=self._rate_hz,
            instruction=self._instruction,
        )

    # ---- the logs

    def _values(self, name: str) -> Iterator[dict[str, Any]]:
        """Yield the JSON objects in a log's new lines; other lines are skipped."""
        for line in self._logs[name].read():
            with contextlib.suppress(ValueError, RecursionError):
                value = json.loads(line)
                if isinstance(value, dict):
                    yield value

    def _rows(self, name: str, kind: type[Row]) -> list[Row]:
        """Return the valid rows of a kind in a log's new lines."""
        rows = (parse_row(value, kind)[0] for value in self._values(name))
        return [row for row in rows if row is not None]

    def _take_truth(self, value: dict[str, Any]) -> None:
        kind = TRUTH_ROWS.get(str(value.get("kind")))
        row = None if kind is None else parse_row(value, kind)[0]
        match row:
            case Begin():
                self._begin = row
            case End():
                self._end = row
            case Pose():
                self.trails[row.drone].append(row.position_ned)
            case FrameTruth():
                self._frames[row.drone, row.frame_id] = row

    def _add_limited(self, drone: int, time_us: int, text: str) -> None:
        """Add a message on a safety limit. Equal messages are merged and counted: a limit can act at every step."""
        times = self._limited[drone, text]
        before = f"{text} ({times} times)" if times > 1 else text
        self._messages[drone] = [(t_us, old) for t_us, old in self._messages[drone] if old != before]
        self._limited[drone, text] += 1
        self._add_message(drone, time_us, f"{text} ({times + 1} times)" if times else text)

    def _take_prompt(self, row: LoggedPrompt) -> None:
        with contextlib.suppress(UsageError):  # skip a row that refers to missing text
            prompt = self._reader.read(row)
            if row.role == "pilot":
                self._texts[row.drone].append(prompt.text)

    def _add_message(self, drone: int, time_us: int, text: str) -> None:
        self._messages[drone] = sorted([*self._messages[drone], (time_us, text)], key=itemgetter(0))[-MESSAGES:]

    def _take_decisions(self, decisions: Sequence[Decision]) -> None:
        """Process decisions in order. Decisions of the same step answer one question."""
        steps: dict[int, list[Decision]] = {}
        for decision in decisions:
            steps.setdefault(decision.step, []).append(decision)
        for together in steps.values():
            unanswered = self._texts[together[0].drone]
            confirmed = isinstance(together[0].confirmed_by, int)
            prompt = unanswered.pop(0) if unanswered and not confirmed else ""
            for decision in together:
                self._decisions[decision.drone], self._prompts[decision.drone] = decision, prompt
                self._rate_hz = decision.rate_hz if decision.rate_hz is not None else self._rate_hz
                if decision.declares:
                    self._add_declaration(decision)

    def _add_declaration(self, decision: Decision) -> None:
        true = self._frames.get((decision.drone, decision.frame_id))
        far = "at an unknown distance" if true is None or true.distance_m is None else f"{true.distance_m:.2f} m"
        self._judge_messages.append(
            f"step {decision.step}: {drone_label(decision.drone)} declares, {far} from the target"
        )

    def _read_verdict(self) -> None:
        if self._verdict is not None:
            return
        verdict = json_object(self.folder / layout.VERDICT)
        if verdict is None:
            return
        success, far = verdict.get("success"), verdict.get("ne_m")
        outcome = "not judged" if success is None else "success" if success else "failure"
        self._verdict = outcome + (f", {far:.2f} m from the target" if isinstance(far, float) else "")
        self._judge_messages.append(f"verdict: {self._verdict}")

    # ---- the moment

    def _drone(self, k: int) -> DroneMoment:
        decision, newest = self._decisions.get(k), self._pictures.newest(k)
        picture = None if newest is None else ShownPicture(newest[0], newest[1], self._taken(k, newest[0]))
        chosen = self._chosen(decision) if decision is not None else None
        return replace(
            self._wires.moment(k, self._ground_down),
            messages=self._newest_messages(k),
            prompt=self._prompts.get(k, ""),
            picture=picture,
            decision=decision,
            decided_on=self._decided_on(decision) if decision is not None else None,
            chosen_ned=chosen.place_ned if chosen else None,
            lens_ned=chosen.lens_ned if chosen else None,
        )

    def _chosen(self, decision: Decision) -> ChosenSight | None:
        """Return the ray to the point that a `go` action chose; None for any other action."""
        step, stored = self._sights.get(decision.drone, (None, None))
        if step == decision.step:
            return stored
        go = chosen_go(decision)
        pose = self._wires.pose_at(decision.drone, self._us(decision.t_frame)) if go is not None else None
        if go is None or pose is None:
            return None
        true = self._frames.get((decision.drone, decision.frame_id))
        pitch_deg = UNSET if true is None else true.camera_pitch_deg
        camera = self._camera if pitch_deg is UNSET else replace(self._camera, pitch_deg=pitch_deg)
        new = sight(go, pose.position_ned, pose.attitude, camera)
        self._sights[decision.drone] = (decision.step, new)
        return new

    def _decided_on(self, decision: Decision) -> ShownPicture | None:
        jpeg = self._pictures.of(decision.drone, decision.frame_id)
        return None if jpeg is None else ShownPicture(decision.frame_id, jpeg, decision.t_frame)

    def _taken(self, drone: int, frame_id: int) -> float | None:
        true = self._frames.get((drone, frame_id))
        return true.t if true is not None else None

    def _ground_down(self, north: float, east: float) -> float:
        return self._world.ground_down(north, east) if self._world is not None else 0.0

    def _newest_messages(self, drone: int) -> tuple[str, ...]:
        wires = self._wires.drones.get(drone)
        texts = [(text.time_us, text.text) for text in wires.texts.newest] if wires is not None else []
        messages = sorted([*texts, *self._messages[drone]], key=itemgetter(0))
        return tuple(text for _, text in messages[-MESSAGES:])

    def _state(self, drones: Sequence[DroneMoment]) -> str:
        if self._end is not None:
            return f"over: {self._end.reason}"
        if self._verdict is not None:
            return "over before the episode began"
        if self._begin is not None:
            return "in the air"
        if any(drone.armed for drone in drones):
            return "on the way to the start"
        return "on the ground" if any(drone.position_ned for drone in drones) else "getting ready"

    def _judge_at(self, t_s: float, drones: Sequence[DroneMoment]) -> JudgeMoment:
        if self._world is None or (self.folder / layout.WORLD).exists():
            return JudgeMoment(messages=tuple(self._judge_messages))
        centre = self._world.target_centre(max(0.0, t_s))
        distances = (None if d.position_ned is None else math.dist(d.position_ned, centre) for d in drones)
        return JudgeMoment(centre, tuple(distances), tuple(self._judge_messages))

    def _t(self, time_us: int) -> float:
        return (time_us - self._begin.t0_us) / 1e6 if self._begin is not None else 0.0

    def _us(self, t_s: float) -> int:
        return round(t_s * 1e6) + (self._begin.t0_us if self._begin is not None else 0)
