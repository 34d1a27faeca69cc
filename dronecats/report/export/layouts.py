"""Writes viewer layouts: for Foxglove (`mcap`; Layouts → Import from file) and for PlotJuggler (`ulog`).

To open the second: `plotjuggler --datafile FILE.ulg --layout FILE.xml`. PlotJuggler 3.17
(`DataLoadULog/ulog_parser.cpp`) names curves `topic/field`, array elements `field.00`, and the topics of several drones
`topic.00`, `topic.01`, …. Therefore a fleet needs its own layout. PlotJuggler warns about missing curves, so a layout
has only curves that every complete flight has.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

from dronecats.report.export.conventions import JUDGE, drone_name

FOXGLOVE, SINGLE_DRONE, FLEET = "foxglove-layout.json", "plotjuggler-layout.xml", "plotjuggler-layout-fleet.xml"
FILES: Mapping[str, tuple[str, ...]] = {"mcap": (FOXGLOVE,), "ulog": (SINGLE_DRONE, FLEET)}  # format → file names
COLOURS = ("#1f77b4", "#d62728", "#1ac938", "#ff7f0e")  # one per drone; PlotJuggler's first colours
TRUTH_COLOUR = "#9467bd"  # for the true curves of a single drone; true curves of a fleet have COLOURS
ESTIMATED, TRUE = "vehicle_local_position", "vehicle_local_position_groundtruth"
DECISIONS = "decisions"  # the tab whose plots show points, not only lines


def layout_files(kind: str, drones: set[int]) -> dict[str, int]:
    """Return {name of a layout file: drones in the layout}. `drones` has the fleet size of each flight."""
    if kind == "mcap":
        return {FOXGLOVE: max(drones)}
    fleets = drones - {1}
    return ({SINGLE_DRONE: 1} if 1 in drones else {}) | ({FLEET: max(fleets)} if fleets else {})


def write(path: Path, drones: int) -> int:
    """Write the layout that `path.name` selects for `drones` drones; return its number of panels or plots."""
    if path.name == FOXGLOVE:
        panels = foxglove_layout(drones)
        path.write_text(json.dumps(panels, indent=2) + "\n", encoding="utf-8")
        return len(panels["configById"])
    plots = plotjuggler_layout(drones)
    Xml.indent(plots)
    path.write_bytes(Xml.tostring(plots, encoding="utf-8", xml_declaration=True) + b"\n")
    return sum(1 for _ in plots.iter("plot"))


def foxglove_layout(drones: int) -> dict[str, Any]:
    """Return Foxglove's layout: scene, pictures, map, heights and logs. Scene and map hide the judge's topics."""
    names = [drone_name(number) for number in range(max(1, drones))]
    images = {f"Image!{name}": _image(name) for name in names}
    panels = {
        "3D!scene": _scene(names),
        **images,
        "map!places": {
            "topics": [f"/{name}/location" for name in names],
            "disabledTopics": [f"/{JUDGE}/{name}/location" for name in names],
            "layer": "map",
            "followTopic": f"/{names[0]}/location",
            "zoomLevel": 18,
        },
        "Plot!height": {
            "title": "height, m",
            "paths": [
                {"value": f"/{name}/pose.pose.position.z", "enabled": True, "timestampMethod": "receiveTime"}
                for name in names
            ],
            "xAxisVal": "timestamp",
            "showLegend": True,
        },
        "RosOut!log": {"topicToRender": "/log", "minLogLevel": 1},
        f"RosOut!{JUDGE}": {"topicToRender": f"/{JUDGE}/log", "minLogLevel": 1},
    }
    logs = {"direction": "row", "first": "RosOut!log", "second": f"RosOut!{JUDGE}", "splitPercentage": 65}
    below = {"direction": "row", "first": "map!places", "second": "Plot!height", "splitPercentage": 50}
    left = {"direction": "column", "first": "3D!scene", "second": below, "splitPercentage": 65}
    right = {"direction": "column", "first": _stacked(list(images)), "second": logs, "splitPercentage": 65}
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "row", "first": left, "second": right, "splitPercentage": 55},
    }


def _scene(names: list[str]) -> dict[str, Any]:
    shown: dict[str, dict[str, Any]] = {"/scene": {"visible": True}, f"/{JUDGE}/scene": {"visible": False}}
    shown |= {f"/{name}/pose": {"visible": True, "type": "axis"} for name in names}
    shown |= {f"/{JUDGE}/{name}/pose": {"visible": False, "type": "axis"} for name in names}
    shown |= {f"/{name}/camera/calibration": {"visible": True} for name in names}
    return {
        "followTf": names[0],
        "followMode": "follow-position",
        "fixedFrame": "map",
        "cameraState": {"distance": 25, "perspective": True, "phi": 60, "thetaOffset": 45},
        "topics": shown,
        "layers": {"grid": {"layerId": "foxglove.Grid", "instanceId": "grid", "visible": True, "size": 200,
                            "divisions": 40, "frameId": "map"}},
    }  # fmt: skip


def _image(name: str) -> dict[str, Any]:
    return {
        "imageMode": {
            "imageTopic": f"/{name}/camera/image",
            "calibrationTopic": f"/{name}/camera/calibration",
            "annotations": {f"/{name}/camera/chosen": {"visible": True}},
        },
        "topics": {},
    }


def _stacked(panels: list[str]) -> Any:
    """Return panels of equal height, one above the other."""
    if len(panels) == 1:
        return panels[0]
    rest = _stacked(panels[1:])
    return {"direction": "column", "first": panels[0], "second": rest, "splitPercentage": round(100 / len(panels))}


Curves = list[dict[str, str]]  # the attributes of the curves of a plot


def plotjuggler_layout(drones: int) -> Xml.Element:
    """Return PlotJuggler's layout: tabs for path, place, speed and decisions, then tabs with the judge's data."""
    root = Xml.Element("root")
    window = Xml.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    for name, plots in _tabs(drones):
        _tab(window, name, plots, "LinesAndDots" if name == DECISIONS else "Lines")
    Xml.SubElement(window, "currentTabIndex", index="0")
    Xml.SubElement(root, "use_relative_time_offset", enabled="1")
    return root


def _tabs(drones: int) -> Iterator[tuple[str, dict[str, Curves]]]:
    """Yield the name of each tab, and its plots: {title of the plot: curves}."""

    def curves(topic: str, field: str, against: str | None = None, colour: str | None = None) -> Curves:
        """Return the curves of a field over time, or over another field."""
        drawn = []
        for drone, own in enumerate((COLOURS * drones)[:drones]):
            source = topic if drones == 1 else f"{topic}.{drone:02}"
            name = f"{source}/[{against};{field}]" if against else f"{source}/{field}"
            axes = {"curve_x": f"{source}/{against}", "curve_y": f"{source}/{field}"} if against else {}
            drawn.append({"name": name, "color": colour or own, **axes})
        return drawn

    def beside_truth(field: str, against: str | None = None) -> Curves:
        return curves(ESTIMATED, field, against) + curves(TRUE, field, against, TRUTH_COLOUR if drones == 1 else None)

    yield "path", {"north over east, m": curves(ESTIMATED, "x", "y")}
    places = (("x", "north, m"), ("y", "east, m"), ("z", "down, m"))
    yield "place", {title: curves(ESTIMATED, field) for field, title in places}
    yield "speed", {f"{title}/s": curves(ESTIMATED, f"v{field}") for field, title in places}
    answers = (("action", "1 go, 2 rotate, 3 think, 4 finished"), ("depth_m", "depth, m"), ("latency_s", "latency, s"))
    yield DECISIONS, {title: curves("agent_decision", field) for field, title in answers}
    yield f"{JUDGE}: path", {"north over east, m, and the truth": beside_truth("x", "y")}
    yield f"{JUDGE}: place", {f"{title}, and the truth": beside_truth(field) for field, title in places}


def _tab(window: Xml.Element, name: str, plots: Mapping[str, Curves], style: str) -> None:
    """Add a tab with plots of equal height, one below the other."""
    container = Xml.SubElement(Xml.SubElement(window, "Tab", tab_name=name, containers="1"), "Container")
    sizes = ";".join([f"{1 / len(plots):.4f}"] * len(plots))
    splitter = Xml.SubElement(container, "DockSplitter", orientation="-", count=str(len(plots)), sizes=sizes)
    for title, curves in plots.items():
        area = Xml.SubElement(splitter, "DockArea", name=title)
        mode = "XYPlot" if "curve_x" in curves[0] else "TimeSeries"
        made = Xml.SubElement(area, "plot", mode=mode, style=style, flip_x="false", flip_y="false")
        for curve in curves:
            Xml.SubElement(made, "curve", curve)
