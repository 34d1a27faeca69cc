"""A flight's folder, followed while it is written: at every turn the moment that it has come to."""

import contextlib
import json
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.view.live.folder import FrameTail, LineTail, PictureTail, instruction_in, lens_in
from dronecats.view.live.moment import ChosenSight, DroneMoment, JudgeMoment, Moment, ShownPicture, chosen_go, sight
from dronecats.view.live.wire_state import HeardFlight
from episodes.world.world import World
from foundation.errors import UsageError
from foundation.frames import Vec3
from foundation.run_folder import layout
from foundation.run_folder.prompts import PromptReader
from foundation.run_folder.reading import Row, json_object, taken
from foundation.run_folder.rows import (
    TRUTH_ROWS,
    Begin,
    Decision,
    End,
    Exchange,
    FrameTruth,
    LoggedPrompt,
    Pose,
    drone_label,
)

WORDS = 20  # of autopilot, envelope and commander that are remembered of each drone


class FlightFollower:
    """Follows one episode folder; `turn` never waits, and takes what it finds as it is."""

    def __init__(self, folder: Path, world: World | None, drones: int) -> None:
        """`world` is the flight's, None where none is known; `drones`: how many fly."""
        self.folder, self._world, self._drones = folder, world, drones
        scene = world.scene if world is not None else None
        origin = (scene.latitude_deg, scene.longitude_deg, scene.altitude_m) if scene is not None else None
        self._camera, self._instruction = lens_in(folder), instruction_in(folder)
        self._heard = HeardFlight(origin)
        self._wire = FrameTail(folder / layout.TLOG)
        self._logs = {name: LineTail(folder / name) for name in
                      (layout.TRUTH, layout.PROMPTS, layout.DECISIONS, layout.SAFETY, layout.COMMANDER)}  # fmt: skip
        self._pictures = PictureTail(folder / layout.FRAMES)
        self._begin: Begin | None = None
        self._end: End | None = None
        self._frames: dict[tuple[int, int], FrameTruth] = {}
        self._decisions: dict[int, Decision] = {}  # the newest of each drone
        self._reader = PromptReader()
        self._texts: dict[int, list[str]] = defaultdict(list)  # first drone of a question → texts of unanswered ones
        self._prompts: dict[int, str] = {}  # drone → the text that its newest decision answers
        self._sights: dict[int, tuple[int, ChosenSight]] = {}  # of the newest decision of each drone: (step, …)
        self._rate_hz: float | None = None
        self._said: dict[int, list[tuple[int, str]]] = defaultdict(list)  # of each drone: µs of vehicle time, text
        self._limits: dict[int, list[str]] = {}  # of the envelope, that act on each drone
        self._limited: Counter[tuple[int, str]] = Counter()  # how often the envelope has said what of which drone
        self._judged: list[str] = []
        self._verdict: str | None = None
        self.trails: dict[int, list[Vec3]] = defaultdict(list)  # m, NED: where each drone truly was, twice a second

    @property
    def over(self) -> bool:
        """Whether the flight has been judged: nothing more will come."""
        return self._verdict is not None

    def turn(self) -> Moment:
        """Take in what has come, and return the moment that it makes."""
        self._heard.feed(self._wire.read())
        for row in self._rows(layout.TRUTH):
            self._take_truth(row)
        for value in self._rows(layout.SAFETY):
            self._take_safety(value)
        for value in self._rows(layout.COMMANDER):
            self._take_exchange(value)
        for value in self._rows(layout.PROMPTS):
            self._take_prompt(value)
        made = [self._row(value, Decision) for value in self._rows(layout.DECISIONS)]
        self._take_decisions([decision for decision in made if decision is not None])
        self._judge()
        t_s = self._t(self._heard.time_us) if self._begin is not None else 0.0
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

    def _rows(self, name: str) -> list[dict[str, Any]]:
        """Return the objects in a log's new lines; what is none is passed over."""
        found = []
        for line in self._logs[name].read():
            try:
                value = json.loads(line)
            except (ValueError, RecursionError):
                continue
            if isinstance(value, dict):
                found.append(value)
        return found

    @staticmethod
    def _row(value: dict[str, Any], kind: type[Row]) -> Row | None:
        return taken(value, kind)[0]

    def _take_truth(self, value: dict[str, Any]) -> None:
        kind = TRUTH_ROWS.get(str(value.get("kind")))
        row = None if kind is None else self._row(value, kind)
        match row:
            case Begin():
                self._begin = row
            case End():
                self._end = row
            case Pose():
                self.trails[row.drone].append(row.position_ned)
            case FrameTruth():
                self._frames[row.drone, row.frame_id] = row

    def _take_safety(self, value: dict[str, Any]) -> None:
        limits, drone, time_us = value.get("limits"), value.get("drone"), value.get("time_us")
        if isinstance(limits, list) and isinstance(drone, int) and isinstance(time_us, int):
            begun = [str(name) for name in limits if name not in self._limits.get(drone, [])]
            self._limits[drone] = limits
            if begun:
                self._say_limited(drone, time_us, f"envelope: limited by {', '.join(begun)}")

    def _say_limited(self, drone: int, time_us: int, text: str) -> None:
        """Say what limits began to act, in the place of the same words before: a limit may act at every step."""
        times = self._limited[drone, text]
        before = f"{text} ({times} times)" if times > 1 else text
        self._said[drone] = [said for said in self._said[drone] if said[1] != before]
        self._limited[drone, text] += 1
        self._say(drone, time_us, f"{text} ({times + 1} times)" if times else text)

    def _take_prompt(self, value: dict[str, Any]) -> None:
        row = self._row(value, LoggedPrompt)
        if row is not None:
            with contextlib.suppress(UsageError):  # its first line was lost
                prompt = self._reader.read(row)
                if row.role == "pilot":
                    self._texts[row.drone].append(prompt.text)

    def _take_exchange(self, value: dict[str, Any]) -> None:
        exchange = self._row(value, Exchange)
        if exchange is None or exchange.t_answered is None:
            return
        for order in exchange.orders:
            self._say(order.drone, self._us(exchange.t_answered), f"commander: {order.goal}")

    def _say(self, drone: int, time_us: int, text: str) -> None:
        self._said[drone] = sorted([*self._said[drone], (time_us, text)], key=lambda said: said[0])[-WORDS:]

    def _take_decisions(self, decisions: Sequence[Decision]) -> None:
        """Take decisions in their order; those of one step came of one question."""
        steps: dict[int, list[Decision]] = {}
        for one in decisions:
            steps.setdefault(one.step, []).append(one)
        for together in steps.values():
            unanswered = self._texts[together[0].drone]
            confirmed = isinstance(together[0].confirmed_by, int)
            prompt = unanswered.pop(0) if unanswered and not confirmed else ""
            for one in together:
                self._decisions[one.drone], self._prompts[one.drone] = one, prompt
                self._rate_hz = one.rate_hz if one.rate_hz is not None else self._rate_hz
                if one.declares:
                    self._declared(one)

    def _declared(self, decision: Decision) -> None:
        true = self._frames.get((decision.drone, decision.frame_id))
        far = "at a distance nobody measured" if true is None or true.distance_m is None else f"{true.distance_m:.2f} m"
        self._judged.append(f"step {decision.step}: {drone_label(decision.drone)} declares, {far} from the target")

    def _judge(self) -> None:
        if self._verdict is not None or self._end is None:
            return
        verdict = json_object(self.folder / layout.VERDICT)
        if verdict is None:
            return
        success, far = verdict.get("success"), verdict.get("ne_m")
        told = "not judged" if success is None else "success" if success else "failure"
        self._verdict = told + (f", {far:.2f} m from the target" if isinstance(far, float) else "")
        self._judged.append(f"verdict: {self._verdict}")

    # ---- the moment

    def _drone(self, k: int) -> DroneMoment:
        decision, newest = self._decisions.get(k), self._pictures.newest(k)
        picture = None if newest is None else ShownPicture(newest[0], newest[1], self._taken(k, newest[0]))
        chosen = self._chosen(decision) if decision is not None else None
        return replace(
            self._heard.moment(k, self._ground_down),
            said=self._words(k),
            prompt=self._prompts.get(k, ""),
            picture=picture,
            decision=decision,
            decided_on=self._decided_on(decision) if decision is not None else None,
            chosen_ned=chosen.place_ned if chosen else None,
            lens_ned=chosen.lens_ned if chosen else None,
        )

    def _chosen(self, decision: Decision) -> ChosenSight | None:
        """Return the ray of a go from where its picture was taken, None of any other action."""
        known = self._sights.get(decision.drone)
        if known is not None and known[0] == decision.step:
            return known[1]
        go = chosen_go(decision)
        pose = self._heard.pose_at(decision.drone, self._us(decision.t_frame)) if go is not None else None
        if go is None or pose is None:
            return None
        made = sight(go, pose.position_ned, pose.attitude, self._camera)
        self._sights[decision.drone] = (decision.step, made)
        return made

    def _decided_on(self, decision: Decision) -> ShownPicture | None:
        jpeg = self._pictures.of(decision.drone, decision.frame_id)
        return None if jpeg is None else ShownPicture(decision.frame_id, jpeg, decision.t_frame)

    def _taken(self, drone: int, frame_id: int) -> float | None:
        true = self._frames.get((drone, frame_id))
        return true.t if true is not None else None

    def _ground_down(self, north: float, east: float) -> float:
        return self._world.ground_down(north, east) if self._world is not None else 0.0

    def _words(self, drone: int) -> tuple[str, ...]:
        heard = self._heard.drones.get(drone)
        texts = [(said.time_us, said.text) for said in heard.texts.newest] if heard is not None else []
        both = sorted([*texts, *self._said[drone]], key=lambda said: said[0])
        return tuple(text for _, text in both[-WORDS:])

    def _state(self, drones: Sequence[DroneMoment]) -> str:
        if self._end is not None:
            return f"over: {self._end.reason}"
        if self._begin is not None:
            return "in the air"
        if any(drone.armed for drone in drones):
            return "on the way to the start"
        return "on the ground" if any(drone.position_ned for drone in drones) else "getting ready"

    def _judge_at(self, t_s: float, drones: Sequence[DroneMoment]) -> JudgeMoment:
        if self._world is None or (self.folder / layout.WORLD).exists():
            return JudgeMoment(said=tuple(self._judged))
        centre = self._world.target_centre(max(0.0, t_s))
        far = tuple(
            None
            if one.position_ned is None
            else sum((a - b) ** 2 for a, b in zip(one.position_ned, centre, strict=True)) ** 0.5
            for one in drones
        )
        return JudgeMoment(centre, far, tuple(self._judged))

    def _t(self, time_us: int) -> float:
        return (time_us - self._begin.t0_us) / 1e6 if self._begin is not None else 0.0

    def _us(self, t_s: float) -> int:
        return round(t_s * 1e6) + (self._begin.t0_us if self._begin is not None else 0)
