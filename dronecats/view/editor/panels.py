"""The panels of the editor: the fields of the draft, the camera's picture, and the checks."""

from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
import viser

from dronecats.report.kit.palette import LIGHT
from dronecats.view.editor.assessment import PREVIEW
from dronecats.view.editor.draft import Draft, Drafting, DraftOperation
from episodes.authoring.check.finding import ALTITUDE_M, RuleFinding
from episodes.maps import assets
from episodes.records.record import CELLS, MAX_SEED

GREEN, RED, GREY = (LIGHT[name] for name in ("good", "bad", "mute"))


def checks_html(findings: Sequence[RuleFinding], fresh: bool) -> str:
    """Return the checks as HTML, failed ones first; dimmed if not `fresh`, that is, if they are of an older draft."""
    failed = [f for f in findings if not f.passed]
    title = f"{len(findings) - len(failed)} of {len(findings)} checks passed" if findings else "Checking …"
    color = GREY if not findings else RED if failed else GREEN
    rows = "".join(_row(f) for f in (*failed, *(f for f in findings if f.passed)))
    return (
        f'<div id="checks" data-failed="{len(failed)}" data-fresh="{str(fresh).lower()}" '
        f'style="font-size:12px;line-height:1.35;padding:2px 10px 8px;opacity:{1.0 if fresh else 0.55}">'
        f'<div style="font-size:14px;font-weight:600;color:{color};margin:4px 0 6px">{title}</div>{rows}</div>'
    )


def _row(finding: RuleFinding) -> str:
    rule = finding.rule.removeprefix("the ")
    color, mark = (GREEN, "✓") if finding.passed else (RED, "✗")
    wanted = f'<div style="opacity:0.65">required: {escape(finding.wanted)}</div>' if not finding.passed else ""
    measured = f"<b>{escape(finding.measured)}</b>{wanted}"
    return (
        f'<div title="required: {escape(finding.wanted)}" '
        'style="display:flex;gap:7px;padding:2px 0;border-top:1px solid rgba(128,128,128,0.18)">'
        f'<span style="color:{color};font-weight:700">{mark}</span>'
        f'<span style="flex:1">{escape(rule[:1].upper() + rule[1:])}</span>'
        f'<span style="text-align:right;max-width:50%;color:{color}">{measured}</span></div>'
    )


def facts_html(rows: Sequence[tuple[str, str]]) -> str:
    """Return (name, value) pairs as HTML, one line per pair."""
    lines = "".join(
        f'<div style="display:flex;justify-content:space-between"><span style="opacity:0.65">{escape(name)}</span>'
        f"<b>{escape(value)}</b></div>"
        for name, value in rows
    )
    return f'<div style="font-size:12px;line-height:1.6;padding:2px 10px 6px">{lines}</div>'


CLICKS = {  # choice in the dropdown → meaning of a click on the map
    "Look around": "",
    "Place the target": "target",
    "Add a point to the path": "waypoint",
    "Place the drone": "drone",
    "Add a look-alike": "candidate",
    "Use an object of the map": "native",
}
NATIVE = "(an object of the map)"


class Panels:
    """Shows the fields of a draft, and calls functions when a user edits them."""

    def __init__(
        self,
        server: viser.ViserServer,
        drafting: Drafting,
        title: str,
        steps: Mapping[str, Callable[[], Any]],
        do: Callable[[DraftOperation, Any], None],
        save: Callable[[bool, Any], None],
        select: Callable[[int], None],
    ) -> None:
        """`steps`: the buttons of the undo history. `do` gets an operation and the user's client.

        `save` gets whether to replace the file, and the client; `select` the index of the chosen drone.
        """
        self._gui, self._drafting, self._select = server.gui, drafting, select
        self._do_for = do
        self.drone = 0  # index of the drone whose fields are shown
        self._inscribed = 0
        server.gui.set_panel_label(title)
        view = server.gui.add_panel()
        with view.add_tab("Camera and checks", viser.Icon.CAMERA):
            blank = np.full((PREVIEW.height, PREVIEW.width, 3), 40, np.uint8)
            self._picture = self._gui.add_image(blank, format="jpeg", jpeg_quality=88)
            self._facts = self._gui.add_html("")
            self._checks = self._gui.add_html(checks_html((), False))
        view.dock_left()
        view.set_width(400)
        self._clicks: Any = self._gui.add_dropdown("A click on the map", tuple(CLICKS), initial_value="Look around")
        self._steps = self._gui.add_button_group("Step", tuple(steps))
        self._steps.on_click(lambda event: steps[event.target.value]())
        tabs = self._gui.add_tab_group()
        with tabs.add_tab("Target", viser.Icon.TARGET):
            self._target_tab()
        with tabs.add_tab("Drones", viser.Icon.DRONE):
            self._drones_tab()
        with tabs.add_tab("Episode", viser.Icon.FILE_TEXT):
            self._episode_tab()
        self._save = self._gui.add_button("Write the record", icon=viser.Icon.DEVICE_FLOPPY)
        self._replace = self._gui.add_button("Replace the file", color="red", visible=False)
        self._save.on_click(lambda event: save(False, event.client))
        self._replace.on_click(lambda event: save(True, event.client))
        self._note = self._gui.add_markdown("")

    @property
    def click(self) -> str:
        """The meaning of a click on the map: '', 'target', 'waypoint', 'drone', 'candidate' or 'native'."""
        return CLICKS[self._clicks.value]

    def show(self, draft: Draft) -> None:
        record, target = draft.record, draft.record.target
        options = (*assets.names(), NATIVE) if target.native else tuple(assets.names())
        if self._asset.options != options:
            self._asset.options = options
        self._asset.value = NATIVE if target.native else target.asset
        if target.paint:
            self._paint.value = target.paint
        self._paint.disabled = target.native is not None
        bearers = ("target", *(f"look-alike {k}" for k in range(1, len(record.candidates) + 1)))
        if self._bearer.options != bearers:
            self._bearer.options = bearers
            self._inscribed = min(self._inscribed, len(bearers) - 1)
            self._bearer.value = bearers[self._inscribed]
        self._bearer.visible = self._fewer.visible = len(bearers) > 1
        self._text.value = (target, *record.candidates)[self._inscribed].inscription or ""
        self._path_group.visible = target.path is not None
        if target.path is not None:
            self._speed.value = target.path.speed_mps
        self.drone = min(self.drone, len(record.starts) - 1)
        drones = tuple(f"drone {k}" for k in range(1, len(record.starts) + 1))
        if self._which.options != drones:
            self._which.options = drones
        self._which.value = drones[self.drone]
        start = record.starts[self.drone]
        self._height.value = round(min(max(self._drafting.height(start), 0.3), 10.0), 2)
        self._yaw.value = round((start.yaw_deg + 180.0) % 360.0 - 180.0, 1)
        self._cell.value = record.cell
        self._words.value = record.instruction
        self._id.value = record.id
        self._seed.value = record.seed
        north, east, _ = target.position_ned or (target.path.waypoints_ned[0] if target.path else (0.0, 0.0, 0.0))
        rows = [
            ("target", f"{north:.2f} m north, {east:.2f} m east"),
            ("distance", f"{record.start_distance_m:.2f} m"),
            ("bearing", f"{record.bearing_deg:.1f}°"),
        ]
        self._facts.content = facts_html(rows)

    def show_picture(self, picture: Any) -> None:
        self._picture.image = picture

    def show_checks(self, findings: Sequence[RuleFinding], fresh: bool) -> None:
        self._checks.content = checks_html(findings, fresh)

    def show_note(self, text: str, replaceable: bool = False) -> None:
        """Show a sentence under the save button."""
        self._note.content = text.replace("_", "\\_").replace("*", "\\*")
        self._replace.visible = replaceable

    # ---- tabs

    def _do(self, event: Any, operation: DraftOperation) -> None:
        """Apply an operation if a user caused the event; updates by the program have no client and are ignored."""
        if event.client is not None:
            self._do_for(operation, event.client)

    def _target_tab(self) -> None:
        drafting, gui = self._drafting, self._gui
        self._asset: Any = gui.add_dropdown("Asset", tuple(assets.names()), initial_value="suv")
        self._paint: Any = gui.add_dropdown("Paint", assets.PAINTS, initial_value="cyan")
        self._bearer: Any = gui.add_dropdown("Inscription of", ("target",), visible=False)
        self._text: Any = gui.add_text("Inscription", "")
        self._fewer = gui.add_button("Remove the last look-alike", visible=False)
        self._path_group = gui.add_folder("Path", visible=False)
        with self._path_group:
            self._speed: Any = gui.add_number("Speed, m/s", 0.3, min=0.01, max=10.0, step=0.01)
            self._shorter = gui.add_button("Remove the last leg")

        @self._asset.on_update
        @self._paint.on_update
        def _(event: Any) -> None:
            if self._asset.value != NATIVE:
                self._do(event, lambda d: drafting.choose(d, self._asset.value, self._paint.value))

        @self._bearer.on_update
        def _(event: Any) -> None:
            if event.client is not None:
                self._inscribed = self._bearer.options.index(self._bearer.value)
                self._select(self.drone)  # this also shows the text of the chosen object

        self._text.on_update(
            lambda event: self._do(event, lambda d: drafting.inscribe(d, self._inscribed, self._text.value))
        )
        self._fewer.on_click(lambda event: self._do(event, drafting.drop_candidate))
        self._speed.on_update(lambda event: self._do(event, lambda d: drafting.set_speed(d, self._speed.value)))
        self._shorter.on_click(lambda event: self._do(event, drafting.shorten))

    def _drones_tab(self) -> None:
        drafting, gui = self._drafting, self._gui
        self._which: Any = gui.add_dropdown("Drone", ("drone 1",))
        self._height: Any = gui.add_slider("Height, m", min=0.3, max=10.0, step=0.05, initial_value=ALTITUDE_M[0])
        self._yaw: Any = gui.add_slider("Yaw, °", min=-180.0, max=180.0, step=0.5, initial_value=0.0)
        self._turns = gui.add_button_group("Turn", ("Face target", "90° left", "90° right", "Away"))
        self._far = gui.add_button_group("Stand off", ("12 m", "16 m", "24 m", "48 m"))
        self._fleet = gui.add_button_group("Fleet", ("Add", "Remove", "2 × 2"))

        @self._which.on_update
        def _(event: Any) -> None:
            if event.client is not None:
                self.drone = self._which.options.index(self._which.value)
                self._select(self.drone)

        def height(d: Draft) -> Draft:
            return drafting.raise_start(d, self.drone, self._height.value)

        def yaw(d: Draft) -> Draft:
            north, east, _ = d.record.starts[self.drone].position_ned
            return drafting.move_start(d, self.drone, north, east, self._yaw.value)

        off = {"Face target": 0.0, "90° left": -90.0, "90° right": 90.0, "Away": 180.0}
        fleet = {"Add": drafting.add_start, "Remove": drafting.drop_start, "2 × 2": drafting.grid}
        self._height.on_update(lambda event: self._do(event, height))
        self._yaw.on_update(lambda event: self._do(event, yaw))
        self._turns.on_click(
            lambda event: self._do(event, lambda d: drafting.face(d, self.drone, off[event.target.value]))
        )
        self._far.on_click(
            lambda event: self._do(event, lambda d: drafting.stand_off(d, float(event.target.value.split()[0])))
        )
        self._fleet.on_click(lambda event: self._do(event, fleet[event.target.value]))

    def _episode_tab(self) -> None:
        drafting, gui = self._drafting, self._gui
        self._cell: Any = gui.add_dropdown("Cell", CELLS, initial_value=CELLS[0])
        self._words: Any = gui.add_text("Instruction", "", multiline=True)
        self._id: Any = gui.add_text("Id", "")
        self._seed: Any = gui.add_number("Seed", 1, min=0, max=MAX_SEED, step=1)
        self._cell.on_update(lambda event: self._do(event, lambda d: drafting.cell(d, self._cell.value)))
        self._words.on_update(lambda event: self._do(event, lambda d: drafting.instruct(d, self._words.value)))
        self._id.on_update(lambda event: self._do(event, lambda d: drafting.rename(d, self._id.value)))
        self._seed.on_update(lambda event: self._do(event, lambda d: drafting.reseed(d, int(self._seed.value))))
