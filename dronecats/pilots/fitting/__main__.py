"""How the vision pilot errs, fitted to flights of its own: what `--pilot noisy` errs by.

    python -m dronecats.pilots.fitting.vision_errors RUN [--out FILE]

RUN is the run folder of a benchmark that vision flew, pictures or none. Each decision is held against what the logger
wrote of its picture: a go within 5° of the target, or within the sides of its box, takes the target; another go takes
something else, but for the depths with which vision searches; a declaration takes whatever is before it. Of a fleet
only the drone that was most on the target tells how the target is seen. Written is a handful of shares and spreads
(`dronecats.pilots.oracle.vision_errors`), over what ships unless --out says where.
"""

import argparse
from pathlib import Path

import msgspec

from dronecats.pilots.fitting.vision_errors.fit import fit
from dronecats.pilots.oracle import noisy


def main() -> None:
    """Fit, print and write."""
    parser = argparse.ArgumentParser(description="How the vision pilot errs, fitted to flights of its own.")
    parser.add_argument("run", type=Path, help="run folder of a benchmark that vision flew")
    parser.add_argument("--out", type=Path, default=noisy.FILE, help="file to write (default: over what ships)")
    args = parser.parse_args()
    data = msgspec.json.format(msgspec.json.encode(fit(args.run)), indent=2) + b"\n"
    args.out.write_bytes(data)
    print(data.decode(), end="")


if __name__ == "__main__":
    main()
