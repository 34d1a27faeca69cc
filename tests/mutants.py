"""Measures the share of small faults in the core packages that the tests detect (mutation testing).

`python -m tests.mutants FOLDER` clones a commit into FOLDER, records which test file reaches which source line, draws
mutants (one changed expression or statement each) and runs the tests that reach them. An interrupted run resumes.
`--before OTHER` applies OTHER's mutants to this commit instead and compares both runs. The test that killed a mutant
in OTHER runs first. A run needs the package `pytest-cov` and some hours of one core.

Limits: `slow` tests and the folders in LEFT_OUT do not run. For each mutant, test files of LIMIT_S in total run, the
nearest folder first. Coverage does not see lines that run only in other processes or in code compiled by numba. Their
mutants run with the tests of the folder of the same name.
"""

import argparse
import ast
import contextlib
import importlib
import itertools
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import msgspec

from foundation.conversion import decode

ROOT = Path(__file__).resolve().parents[1]
CORE = ["foundation", "autopilot", "vehicles", "episodes", "hil", "dronecats/agent", "dronecats/judge"]
CORE += [f"dronecats/flight/{name}" for name in ("spec", "logger", "sitl")]
LEFT_OUT = ["system", "cli", "docs", "view", "bench", "benchmarks"]  # test folders
COUNT, PER_FILE, SEED = 250, 4, 1  # mutants, mutants of one source file at most, seed of the draw
LIMIT_S = 60.0  # s, total duration of the test files for one mutant
PAIRS = [("Lt", "LtE"), ("Gt", "GtE"), ("Eq", "NotEq"), ("Is", "IsNot"), ("In", "NotIn"), ("And", "Or")]
PAIRS += [("Add", "Sub"), ("Mult", "Div"), ("LShift", "RShift")]
SWAPPED = {"FloorDiv": "Mult", "Mod": "Mult", "Pow": "Mult"} | dict(PAIRS) | {new: old for old, new in PAIRS}
UNTOUCHED = {"annotation", "returns", "decorator_list", "pattern", "keywords of ClassDef"}  # fields of syntax nodes
NO_FAULTS = ("f'", 'f"', "if __name__", "if TYPE_CHECKING", "print(", "warnings.warn(")  # messages, script entry points


class Mutant(msgspec.Struct):
    """One fault and its test result. `before` in a source line becomes `after`."""

    id: int
    path: str  # relative to the repository
    line: int  # from 1
    column: int  # in bytes
    statement: int  # first line of the statement
    text: str  # the source line
    operator: str
    before: str
    after: str
    untraced: bool  # coverage cannot tell its tests: compiled by numba, or run at import
    killed: bool = False
    reason: str = ""  # the test that failed first, or timeout, exit status, survived, unreached, lost (line is gone)
    seconds: float = 0.0


def faults(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Yield the faults of one syntax node: the node that changes and its new text."""
    match node:
        case ast.Compare(ops=[op]) | ast.BoolOp(op=op) | ast.BinOp(op=op) if type(op).__name__ in SWAPPED:
            swapped, copy = getattr(ast, SWAPPED[type(op).__name__])(), ast.parse(ast.unparse(node), mode="eval").body
            setattr(copy, *(("ops", [swapped]) if isinstance(node, ast.Compare) else ("op", swapped)))
            yield node, f"({ast.unparse(copy)})"
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield node, f"({ast.unparse(operand)})"
        case ast.Constant(value=int(value) | float(value)):  # True and False are integers, too
            yield node, f"({not value if isinstance(value, bool) else value + 1!r})"
        case ast.Return(value=ast.expr() as value) if ast.unparse(value) != "None":
            yield value, "None"
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test):
            yield test, f"(not ({ast.unparse(test)}))"
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Raise() | ast.Continue() | ast.Break():
            yield node, "pass"
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield node, "pass"


def walk(node: ast.AST, statement: int, untraced: bool) -> Iterator[tuple[ast.AST, int, bool]]:
    """Yield each syntax node that may change, the first line of its statement and whether it is untraced."""
    if isinstance(node, ast.JoinedStr | ast.If | ast.Expr) and ast.unparse(node).startswith(NO_FAULTS):
        return
    statement = node.lineno if isinstance(node, ast.stmt) else statement
    yield node, statement, untraced
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        untraced = any("njit" in ast.unparse(decorator) for decorator in node.decorator_list)
    for field, value in ast.iter_fields(node):
        if not UNTOUCHED & {field, f"{field} of {type(node).__name__}"}:
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from walk(child, statement, untraced)


def draw(source: Path) -> Iterator[Mutant]:
    """Yield mutants of the core packages. Draws lines uniformly, at most PER_FILE of a file, and one fault per line."""
    lines: dict[tuple[str, int], list[Mutant]] = defaultdict(list)
    for file in sorted(file for package in CORE for file in (source / package).rglob("*.py")):
        data, path = file.read_bytes(), file.relative_to(source).as_posix()
        rows = data.splitlines(keepends=True)
        begin = [0, *itertools.accumulate(map(len, rows))]
        for node, statement, untraced in walk(ast.parse(data), 1, True):
            for changed, after in faults(node):
                assert isinstance(changed, ast.expr | ast.stmt)
                line, column, last = changed.lineno, changed.col_offset, changed.end_lineno or 0
                before = data[begin[line - 1] + column : begin[last - 1] + (changed.end_col_offset or 0)].decode()
                text, operator = rows[line - 1].decode(), type(node).__name__
                mutant = Mutant(0, path, line, column, statement, text, operator, before, after, untraced)
                lines[path, line].append(mutant)
    chance, number, taken = random.Random(SEED), itertools.count(), Counter[str]()
    for path, line in chance.sample(sorted(lines), len(lines)):
        taken[path] += 1
        if taken[path] <= PER_FILE and (place := next(number)) < COUNT:
            yield msgspec.structs.replace(chance.choice(lines[path, line]), id=place)


def mutate(mutant: Mutant, data: bytes) -> bytes | None:
    """Return the source file with the fault, or None if the line is gone. The line may have moved."""
    rows, before = data.splitlines(keepends=True), mutant.before.encode()
    for row in sorted(range(len(rows)), key=lambda row: abs(row + 1 - mutant.line)):
        start = sum(map(len, rows[:row])) + mutant.column
        if rows[row].decode() == mutant.text and data.startswith(before, start):
            return data[:start] + mutant.after.encode() + data[start + len(before) :]
    return None


class Checkout:
    """A clone of one commit in which mutants run, with the coverage and the duration of its tests."""

    def __init__(self, folder: Path, commit: str) -> None:
        self.folder, self.source, self.cache = folder, folder / "source", folder / "cache"
        if not self.source.exists():
            subprocess.run(["git", "clone", "-q", ROOT, self.source], check=True)
            subprocess.run(["git", "checkout", "-q", commit], cwd=self.source, check=True)
        if not (folder / "tests.xml").exists():
            tests = sorted(str(path) for path in self.source.glob("tests/[a-z]*/") if path.name not in LEFT_OUT)
            coverage = [f"--cov={package}" for package in CORE] + ["--cov-context=test", "--cov-report="]
            self._pytest([*tests, *coverage, f"--junitxml={folder}/tests.xml", "-ojunit_family=xunit1"], None)
        self.warm = set(self.cache.glob("*/*"))  # compiled kernels of the commit
        self.seconds: dict[str, float] = defaultdict(float)  # of each test file
        self.failing: list[str] = []
        for case in ElementTree.parse(folder / "tests.xml").iter("testcase"):
            self.seconds[case.attrib["file"]] += float(case.attrib["time"])
            if {"failure", "error"} & {outcome.tag for outcome in case}:
                self.failing.append(f"--deselect={case.attrib['file']}::{case.attrib['name']}")
        self.reach = importlib.import_module("coverage").CoverageData(folder / "coverage")
        self.reach.read()

    def _pytest(self, arguments: list[str], limit: float | None) -> tuple[bool, str]:
        """Run tests. Return whether a test failed, and the first failed test or another reason."""
        command = [sys.executable, "-m", "pytest", "-qrfE", "-pno:cacheprovider", "-mnot slow", "--hypothesis-seed=0"]
        command += arguments
        environment = os.environ | {"NUMBA_CACHE_DIR": str(self.cache), "COVERAGE_FILE": str(self.folder / "coverage")}
        environment["PYTHONPATH"] = f"{self.source}{os.pathsep}{environment.get('PYTHONPATH', '')}"
        with (self.folder / "log").open("w") as log:
            tests = subprocess.Popen(command, cwd=self.source, env=environment, stdout=log, start_new_session=True)
        try:
            status = tests.wait(limit)
        except subprocess.TimeoutExpired:
            return True, "timeout"
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(tests.pid, signal.SIGKILL)  # also kills the processes that the tests started
            tests.wait()
        if status in (0, 5):  # 5: every test is slow
            return False, "survived"
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", (self.folder / "log").read_text(errors="replace"), re.MULTILINE)
        return True, failed[1] if failed else f"exit status {status}"

    def attempt(self, mutant: Mutant) -> Mutant:
        """Run the tests that reach a mutant and return it with the result. A test known to kill it runs first."""
        file, start = self.source / mutant.path, time.monotonic()
        if not file.exists() or (changed := mutate(mutant, data := file.read_bytes())) is None:
            return msgspec.structs.replace(mutant, killed=False, reason="lost")
        selected, stat, killed = self.select(mutant), file.stat(), False
        path, *names = mutant.reason.split("[")[0].split("::")
        is_known = names and path in self.seconds and f"def {names[-1]}(" in (self.source / path).read_text()
        reason = "survived" if selected else "unreached"
        try:
            file.write_bytes(changed)
            for tests in ["::".join([path, *names])] if is_known else [], selected:
                if tests and not killed:
                    limit = 30 + 240 * mutant.untraced + 5 * sum(self.seconds[test.split("::")[0]] for test in tests)
                    killed, reason = self._pytest([*tests, *self.failing, "-x", f"--timeout={limit:.0f}"], 2 * limit)
        finally:
            file.write_bytes(data)
            os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))  # compiled kernels stay valid
            for folder in set(self.cache.glob("*/*")) - self.warm:
                shutil.rmtree(folder)
        return msgspec.structs.replace(mutant, killed=killed, reason=reason, seconds=time.monotonic() - start)

    def select(self, mutant: Mutant) -> list[str]:
        """Return the test files that reach a mutant, nearest folder first, up to LIMIT_S in total."""
        lines = self.reach.contexts_by_lineno(str(self.source / mutant.path))
        rows = lines if mutant.untraced else range(mutant.statement, mutant.line + 1)
        reaching = {context.split("::")[0] for row in rows for context in lines.get(row, []) if context}
        mirrored = Path("tests", mutant.path.removeprefix("dronecats/")).parents
        near = next(folder for folder in mirrored if (self.source / folder).exists())
        if mutant.untraced or not reaching:
            reaching |= {path for path in self.seconds if path.startswith(f"{near}/")}
        ranks = {path: (-len(Path(os.path.commonpath([path, near])).parts), self.seconds[path]) for path in reaching}
        nearest = sorted(ranks, key=lambda path: ranks[path])
        total = itertools.accumulate(self.seconds[path] for path in nearest)
        return [path for path, seconds in zip(nearest, total, strict=True) if path == nearest[0] or seconds < LIMIT_S]


def read(path: Path) -> dict[int, Mutant]:
    rows = [decode(line, Mutant) for line in path.read_bytes().splitlines()] if path.exists() else []
    return {mutant.id: mutant for mutant in rows}


def report(runs: list[dict[int, Mutant]]) -> Iterator[str]:
    """Yield a table of the mutants that all runs tried, and each mutant that the last run no longer kills."""
    yield f"| package | mutants |{' killed |' * len(runs)}\n| --- | ---: |{' ---: |' * len(runs)}"
    common = [key for key in runs[0] if all(key in run and run[key].reason != "lost" for run in runs)]
    for package in [*CORE, ""]:
        rows = [key for key in common if runs[0][key].path.startswith(package)]
        counts = [sum(run[key].killed for key in rows) for run in runs]
        shares = [f"{count} ({count / max(1, len(rows)):.0%})" for count in counts]
        yield f"| {package or 'all'} | {len(rows)} | {' | '.join(shares)} |"
    for before, after in ((runs[0][key], runs[-1][key]) for key in common):
        if before.killed and not after.killed:
            yield f"{after.reason}: {before.path}:{before.line} -> {before.after}, killed before by {before.reason}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--commit", default="HEAD")
    parser.add_argument("--before", type=Path, help="folder of an earlier run")
    parser.add_argument("--minutes", type=float, default=600.0, help="start no mutant after this time")
    options = parser.parse_args()
    end, results = time.monotonic() + 60 * options.minutes, options.folder / "results.jsonl"
    checkout = Checkout(options.folder.resolve(), options.commit)
    runs = [read(path) for path in ([options.before / results.name] if options.before else []) + [results]]
    for mutant in runs[0].values() if options.before else draw(checkout.source):
        if mutant.id not in runs[-1] and time.monotonic() < end:
            runs[-1][mutant.id] = checkout.attempt(mutant)
            with results.open("ab") as file:
                file.write(msgspec.json.encode(runs[-1][mutant.id]) + b"\n")
    sys.stdout.write("\n".join(report(runs)) + "\n")


if __name__ == "__main__":
    main()
