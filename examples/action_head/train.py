"""Train a head: `python -m examples.action_head.train runs/learnt/dataset --out head.pt`."""

import argparse
import time
from dataclasses import asdict
from pathlib import Path

from dronecats.cli.exit_status import exit_status
from examples.action_head.settings import Shape, Training
from foundation import extras
from foundation.errors import UsageError
from foundation.files import file_errors_as
from foundation.protocol import FINISHED


def train(folder: Path, out: Path, training: Training) -> None:
    """Fit a head to the flights of the dataset `folder`, and write it to `out`. Raises UsageError if that fails."""
    extras.require("torch", "pyarrow")
    from examples.action_head import dataset
    from examples.action_head.features import KINDS
    from examples.action_head.fit import fit, judged
    from examples.action_head.network import save

    with file_errors_as(UsageError, f"'{out.parent}' cannot be created", "."):
        out.parent.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    data = dataset.read(folder)
    flights = len(set(data.flights.tolist()))
    print(f"{len(data)} decisions of {flights} flights, {int(data.held_out.sum())} of them held out", flush=True)
    if data.held_out.all():
        raise UsageError(f"{folder} has only held-out flights. Fly more, to have flights to learn from.")
    if not (data.held_out & (data.kinds == KINDS.index(FINISHED))).any():
        raise UsageError(
            f"{folder} has no held-out flight that arrives, so the threshold of a declaration is unknown. Fly more."
        )

    def report(epoch: int, loss: float) -> None:
        print(f"epoch {epoch + 1}/{training.epochs}: loss {loss:.3f}, {time.monotonic() - begun:.0f} s", flush=True)

    head = fit(data, Shape(), training, report)
    result = judged(head, data)
    assert result is not None  # `judged` returns None only if no held-out flight arrives
    print(
        f"held out: {result.right_kind:.0%} right actions of {result.decisions}, points off by"
        f" {result.point_error:.1%} of the width and depths by a factor of {result.depth_factor:.2f} (medians); with"
        f" the threshold {result.declares_at:g}, {result.declared:.0%} of the arrivals are declared and"
        f" {result.precise:.0%} of the declarations are true",
        flush=True,
    )
    save(out, head, result.declares_at, {"flights": flights, "training": asdict(training), "held_out": asdict(result)})
    print(f"{out}, {time.monotonic() - begun:.0f} s", flush=True)


def main(words: list[str] | None = None) -> int:
    """Read the command line and train."""
    normal = Training()
    parser = argparse.ArgumentParser(prog="python -m examples.action_head.train", description=__doc__)
    parser.add_argument("dataset", type=Path, help="folder that `dronecats export --to lerobot` made")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="file of the trained head")
    parser.add_argument("--epochs", type=int, default=normal.epochs, metavar="N", help=f"(default {normal.epochs})")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="the same seed gives the same weights")
    parser.add_argument(
        "--threads", type=int, default=normal.threads, metavar="N", help="threads of PyTorch (default 1)"
    )
    args = parser.parse_args(words)
    if args.epochs < 1 or args.threads < 1:
        raise UsageError("--epochs and --threads must be 1 or more.")
    train(args.dataset, args.out, Training(epochs=args.epochs, seed=args.seed, threads=args.threads))
    return 0


if __name__ == "__main__":
    raise SystemExit(exit_status("action_head", main))
