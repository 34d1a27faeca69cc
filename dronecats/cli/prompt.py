"""`dronecats prompt extract PAPER.tex --out FILE`: a prompt out of a paper's LaTeX source, for `--prompt`."""

import argparse
import shlex
from pathlib import Path


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("prompt")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    extract = actions.add_parser("extract", help="write the prompt listing of a LaTeX source to a file for --prompt")
    extract.add_argument("source", type=Path, metavar="PAPER.tex", help="a LaTeX file with one listing of a prompt")
    extract.add_argument("--out", type=Path, required=True, metavar="FILE", help="the prompt template")
    extract.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the listing. A file that holds something else is left alone: UsageError."""
    from dronecats.agent.prompt import Prompt, prompt_listing
    from foundation.errors import UsageError

    try:
        source = args.source.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"the LaTeX source {args.source} cannot be read: {error}") from None
    template = prompt_listing(source, str(args.source))
    try:
        if args.out.exists() and args.out.read_text(encoding="utf-8") != template:
            raise UsageError(f"{args.out} exists and holds something else; choose another --out")
        args.out.write_text(template, encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--out {args.out} cannot be written: {error}") from None
    prompt = Prompt(template)
    print(f"{args.out}: {len(template):,} characters, prompt {prompt.name}, digest {prompt.digest[:8]}")
    print(f"fly it: dronecats fly --sitl --model NAME --prompt {shlex.quote(str(args.out))}")
    return 0
