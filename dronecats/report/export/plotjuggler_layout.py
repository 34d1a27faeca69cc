"""Layouts for PlotJuggler that show what `ulog` writes: `plotjuggler --datafile FILE.ulg --layout FILE.xml`.

PlotJuggler (`DataLoadULog/ulog_parser.cpp`, 3.17) calls a curve topic/field, an array's element field.00, and a topic
that any drone but the first has topic.00, topic.01, …: so a fleet wants a layout of its own. What it does not find in a
file it names in a warning, so only what is of every flight that was flown to its end is in here.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as Xml

from dronecats.report.export.naming import JUDGE

ALONE, FLEET = "plotjuggler-layout.xml", "plotjuggler-layout-fleet.xml"
NAMES = (ALONE, FLEET)
COLOURS = ("#1f77b4", "#d62728", "#1ac938", "#ff7f0e")  # of drones, the first ones of PlotJuggler
TRUTH_COLOUR = "#9467bd"  # of the only drone; a fleet's truth has the drones' own
ESTIMATED, TRUE = "vehicle_local_position", "vehicle_local_position_groundtruth"


@dataclass(frozen=True, slots=True)
class DrawnCurve:
    """What is drawn: a field against time, or one against another."""

    colour: str
    y: str  # PlotJuggler's name of it
    x: str | None = None  # None: time


@dataclass(frozen=True, slots=True)
class PlotPane:
    """One pair of axes."""

    title: str
    curves: tuple[DrawnCurve, ...]
    style: Literal["Lines", "LinesAndDots", "Sticks"] = "Lines"


def wanted(drones: set[int]) -> dict[str, int]:
    """Return the files that go with flights of these numbers of drones, each with the number that it is for."""
    fleets = drones - {1}
    return ({ALONE: 1} if 1 in drones else {}) | ({FLEET: max(fleets)} if fleets else {})


def write(drones: int, path: Path) -> int:
    """Write a layout for flights of so many drones; return how many plots it has."""
    told = layout(drones)
    Xml.indent(told)
    path.write_bytes(Xml.tostring(told, encoding="utf-8", xml_declaration=True) + b"\n")
    return sum(1 for _ in told.iter("plot"))


def layout(drones: int) -> Xml.Element:
    """Return the layout: a tab each of path, place, speed and decisions; the judge's tabs come last."""
    root = Xml.Element("root")
    window = Xml.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    for name, plots in _tabs(drones):
        _tab(window, name, plots)
    Xml.SubElement(window, "currentTabIndex", index="0")
    Xml.SubElement(root, "use_relative_time_offset", enabled="1")
    return root


def _tabs(drones: int) -> Iterator[tuple[str, list[PlotPane]]]:
    colours = dict(enumerate((COLOURS * drones)[:drones]))

    def curves(topic: str, field: str, against: str | None = None, colour: str | None = None) -> tuple[DrawnCurve, ...]:
        def named(told: str, drone: int) -> str:
            return f"{topic}/{told}" if drones == 1 else f"{topic}.{drone:02}/{told}"

        return tuple(
            DrawnCurve(colour or own, named(field, drone), named(against, drone) if against else None)
            for drone, own in colours.items()
        )

    def beside_truth(field: str, against: str | None = None) -> tuple[DrawnCurve, ...]:
        return curves(ESTIMATED, field, against) + curves(TRUE, field, against, TRUTH_COLOUR if drones == 1 else None)

    yield "path", [PlotPane("north over east, m", curves(ESTIMATED, "x", "y"))]
    places = (("x", "north, m"), ("y", "east, m"), ("z", "down, m"))
    yield "place", [PlotPane(title, curves(ESTIMATED, field)) for field, title in places]
    yield "speed", [PlotPane(f"{title}/s", curves(ESTIMATED, f"v{field}")) for field, title in places]
    answers = (("action", "1 go, 2 rotate, 3 think, 4 finished"), ("depth_m", "depth, m"), ("latency_s", "latency, s"))
    yield "decisions", [PlotPane(title, curves("agent_decision", field), "LinesAndDots") for field, title in answers]
    yield f"{JUDGE}: path", [PlotPane("north over east, m, and the truth", beside_truth("x", "y"))]
    yield f"{JUDGE}: place", [PlotPane(f"{title}, and the truth", beside_truth(field)) for field, title in places]


def _tab(window: Xml.Element, name: str, plots: Sequence[PlotPane]) -> None:
    """Add a tab with its plots one below the other, of the same height."""
    container = Xml.SubElement(Xml.SubElement(window, "Tab", tab_name=name, containers="1"), "Container")
    sizes = ";".join([f"{1 / len(plots):.4f}"] * len(plots))
    splitter = Xml.SubElement(container, "DockSplitter", orientation="-", count=str(len(plots)), sizes=sizes)
    for plot in plots:
        area = Xml.SubElement(splitter, "DockArea", name=plot.title)
        mode = "XYPlot" if plot.curves[0].x else "TimeSeries"
        made = Xml.SubElement(area, "plot", mode=mode, style=plot.style, flip_x="false", flip_y="false")
        for curve in plot.curves:
            if curve.x is None:
                Xml.SubElement(made, "curve", name=curve.y, color=curve.colour)
            else:
                name = f"{curve.y.split('/')[0]}/[{curve.x.split('/')[1]};{curve.y.split('/')[1]}]"
                Xml.SubElement(made, "curve", name=name, color=curve.colour, curve_x=curve.x, curve_y=curve.y)
