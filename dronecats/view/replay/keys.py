"""The keyboard: what each key does, said once for the browser, its list of commands and the page's help."""

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import Any, Protocol, cast

import viser

from dronecats.view.replay.occurrences import OccurrenceKind

STEP_S = 0.1  # s of the episode
CHOICES = 9  # of runs, or drones: as many as there are digits but 0


class ReplayOrders(Protocol):
    """What a key, a button or a list asks of the page."""

    def toggle(self) -> None:
        """Play, or stand still."""

    def step(self, by_s: float) -> None:
        """Go so much later, or earlier, and stand still."""

    def go_to(self, t_s: float) -> None:
        """Go to a time of the episode, s, and stand still."""

    def jump(self, kind: OccurrenceKind, ahead: bool) -> None:
        """Go to the next of its sort, or to the one before."""

    def faster(self) -> None:
        """Play at the next higher speed."""

    def slower(self) -> None:
        """Play at the next lower speed."""

    def at_speed(self, speed: float) -> None:
        """Play at a speed: seconds of flight in one of the wall."""

    def choose(self, number: int) -> None:
        """Choose a run, or a drone where there is one run; 0 is the first."""

    def go_along(self) -> None:
        """Have the view go with the chosen drone, or no longer."""

    def judge(self) -> None:
        """Show what only the judge knows, or hide it."""

    def next_view(self) -> None:
        """Draw the next view of this moment again, after the last one none."""

    def help(self) -> None:
        """Show the keys, or hide them."""


@dataclass(frozen=True, slots=True)
class KeyBinding:
    """What one or two keys do."""

    shown: str  # as a person knows the key
    keys: tuple[tuple[str, str | None], ...]  # the browser's name of the key, and what is held with it
    does: str
    order: Callable[[ReplayOrders], None]


END_S = 1e9  # s, later than any flight: the clock goes to its own end
DECISION, DECLARATION, FAULT = OccurrenceKind.DECISION, OccurrenceKind.DECLARATION, OccurrenceKind.FAULT
KEYS: tuple[KeyBinding, ...] = (
    KeyBinding("Space", (("space", None),), "play, or stand still", lambda o: o.toggle()),
    KeyBinding("→", (("arrowright", None),), "to the next decision", lambda o: o.jump(DECISION, True)),
    KeyBinding("←", (("arrowleft", None),), "to the decision before", lambda o: o.jump(DECISION, False)),
    KeyBinding("Shift →", (("arrowright", "shift"),), "0.1 s later", lambda o: o.step(STEP_S)),
    KeyBinding("Shift ←", (("arrowleft", "shift"),), "0.1 s earlier", lambda o: o.step(-STEP_S)),
    KeyBinding("Home", (("home", None),), "to the beginning", lambda o: o.go_to(0.0)),
    KeyBinding("End", (("end", None),), "to the end", lambda o: o.go_to(END_S)),
    KeyBinding("+", (("[plus]", None), ("[plus]", "shift"), ("=", None)), "faster", lambda o: o.faster()),
    KeyBinding("-", (("-", None),), "slower", lambda o: o.slower()),
    KeyBinding("D", (("D", None),), "to the next declaration", lambda o: o.jump(DECLARATION, True)),
    KeyBinding("Shift D", (("D", "shift"),), "to the declaration before", lambda o: o.jump(DECLARATION, False)),
    KeyBinding("F", (("F", None),), "to what went wrong next", lambda o: o.jump(FAULT, True)),
    KeyBinding("Shift F", (("F", "shift"),), "to what went wrong before", lambda o: o.jump(FAULT, False)),
    KeyBinding("V", (("V", None),), "draw this moment again: from behind, from above, through its camera, not at all",
               lambda o: o.next_view()),
    KeyBinding("G", (("G", None),), "go with the chosen drone, or stay", lambda o: o.go_along()),
    KeyBinding("J", (("J", None),), "the judge's view, or without", lambda o: o.judge()),
    KeyBinding("?", (("?", "shift"), ("?", None)), "these keys", lambda o: o.help()),
)  # fmt: skip


def digit(number: int) -> KeyBinding:
    """Return what the key 1 … 9 does; `number` counts from 0."""
    key = str(number + 1)
    return KeyBinding(key, ((key, None),), f"choose {key}", lambda o: o.choose(number))


def bind(server: viser.ViserServer, orders: ReplayOrders, choices: int) -> None:
    """Have every key reach `orders`, in the order in which they are pressed; so many digits choose."""
    for binding in (*KEYS, *(digit(number) for number in range(min(choices, CHOICES)))):
        for key, held in binding.keys:
            said = binding.does[0].upper() + binding.does[1:]
            command = server.gui.add_command(said, hotkey=cast(Any, key), modifier=cast(Any, held))
            command.on_trigger(_in_turn(binding, orders))


def _in_turn(binding: KeyBinding, orders: ReplayOrders) -> Callable[[Any], Any]:
    async def pressed(_: Any) -> None:  # async: one after the other, in the order in which they came
        binding.order(orders)

    return pressed


def keys_html(choices: str) -> str:
    """Return the list of the keys; `choices` says what digits choose, "": they do nothing."""
    rows = [(binding.shown, binding.does) for binding in KEYS]
    if choices:
        rows.insert(-1, ("1 … 9", f"choose a {choices}"))
    cells = "".join(
        f'<tr><td style="padding:1px 14px 1px 0"><b>{escape(key)}</b></td><td>{escape(does)}</td></tr>'
        for key, does in rows
    )
    return f'<table class="keys" style="font-size:13px;line-height:1.5">{cells}</table>'
