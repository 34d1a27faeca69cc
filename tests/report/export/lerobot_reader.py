"""Run by an interpreter that has LeRobot: prints what LeRobot's own dataset class finds, as one JSON object."""

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
        told = {name: plain(value) for name, value in item.items()}
        items.append({**told, "shape": list(picture.shape), "colour": picture.mean(dim=(1, 2)).tolist()})
    stats = {name: {key: plain(v) for key, v in one.items()} for name, one in dataset.meta.stats.items()}
    found = {"frames": len(dataset), "episodes": dataset.num_episodes, "fps": dataset.fps, "stats": stats}
    lengths = [dataset.meta.episodes[k]["length"] for k in range(dataset.num_episodes)]
    print(json.dumps({**found, "lengths": lengths, "items": items}))  # noqa: T201


main(sys.argv[1])
