"""Runs in an interpreter that has LeRobot. Prints the content of LeRobot's own dataset class as one JSON object."""

import json
import sys

from lerobot.datasets.lerobot_dataset import LeRobotDataset


def plain(value):
    return value.tolist() if hasattr(value, "tolist") else value


def main(root):
    dataset = LeRobotDataset("dronecats/flown", root=root, delta_timestamps={"action": [0.0, 1.0]})
    items = []
    for index in range(len(dataset)):
        item = dataset[index]
        picture = item.pop("observation.images.front")
        values = {name: plain(value) for name, value in item.items()}
        items.append({**values, "shape": list(picture.shape), "colour": picture.mean(dim=(1, 2)).tolist()})
    stats = {name: {key: plain(v) for key, v in entry.items()} for name, entry in dataset.meta.stats.items()}
    summary = {"frames": len(dataset), "episodes": dataset.num_episodes, "fps": dataset.fps, "stats": stats}
    lengths = [dataset.meta.episodes[k]["length"] for k in range(dataset.num_episodes)]
    print(json.dumps({**summary, "lengths": lengths, "items": items}))  # noqa: T201


main(sys.argv[1])
