"""A layout for Foxglove that shows what `mcap` writes: Layouts → Import from file."""

import json
from pathlib import Path
from typing import Any

from dronecats.report.export.naming import JUDGE, drone_name

NAMES = ("foxglove-layout.json",)


def wanted(drones: set[int]) -> dict[str, int]:
    """Return the file that goes with flights of these numbers of drones, with the number that it is for."""
    return {NAMES[0]: max(drones)}


def write(drones: int, path: Path) -> int:
    """Write a layout for flights of so many drones; return how many panels it has. The judge's are hidden at first."""
    told = layout(drones)
    path.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
    return len(told["configById"])


def layout(drones: int) -> dict[str, Any]:
    """Return the layout: the scene, the picture of each drone, the map, heights and the log."""
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
    """Return panels one above the other, of the same height."""
    if len(panels) == 1:
        return panels[0]
    rest = _stacked(panels[1:])
    return {"direction": "column", "first": panels[0], "second": rest, "splitPercentage": round(100 / len(panels))}
