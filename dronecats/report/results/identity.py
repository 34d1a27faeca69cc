"""What makes runs of one kind, so that their episodes may be counted together, and in what two runs differ.

Everything that run.json says was asked for and was there belongs to it, but for what tells flights of one kind apart
and for what was only measured. What an older run does not tell is equal to nothing but another that does not tell it.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.agent.names import FORMER, agent_name
from dronecats.report.recorded.run import RecordedRun
from foundation.run_folder import layout
from foundation.run_folder.reading import json_object, taken
from foundation.run_folder.rows import EpisodeIdentity

NOT_TOLD = "not told"
NAMES = {  # key of run.json → what it is called in a sentence
    "code_sha256": "the code",
    "prompt_sha256": "the prompt",
    "commander_prompt_sha256": "the commander's prompt",
    "agent": "the agent",
    "clock": "the clock",
    "camera": "the camera",
    "map_sha256": "the map",
    "firmware": "the firmware",
}
# of a flight; prompt and agent are known by what they came to, and a recorded latency is named after its own
FREE = ("seed", "episode", "record", "accounts", "prompt", "agent", "latency_trace", "keep_ulog")
PARTS = ("the suite ", "the protocol's ")  # of which one may have what the other has not, as each has its own suite
DIGEST = re.compile(r"\b([0-9a-f]{8})[0-9a-f]{24,}\b")

Identity = Mapping[str, frozenset[str]]  # what → its values, of a run mostly one


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing in which two runs differ."""

    what: str  # "the prompt", "latency", "the version of numpy"
    values: tuple[str, ...]  # in words, of the one and of the other

    def __str__(self) -> str:
        told = (DIGEST.sub(r"\1", value) for value in self.values)
        return f"{self.what} ({' and '.join(told)})"


def identity(run: RecordedRun) -> dict[str, frozenset[str]]:
    """Return all by which a run is of its kind."""
    told = dict(_of_run(run.configuration))
    flown = [one for folder in run.episodes if (one := _of_episode(folder)) is not None]
    codes = {one.code_sha256 for one in flown}
    told["the code"] = frozenset(codes) | (told["the code"] - {NOT_TOLD} if codes else told["the code"])
    served = {name for one in flown for name in one.served}
    told["the model as served"] = frozenset(served) or frozenset({NOT_TOLD})
    return told


def identity_digest(told: Identity) -> str:
    """Return the SHA-256 by which runs of one kind are told from others."""
    # with the names of version 0.1.0, whose archives tell such a digest
    former = {name: made for made, name in FORMER.items()}
    agents = frozenset(former.get(name, name.replace(":", ".")) for name in told.get("the agent", ()))
    all_of_it = {**told, "the agent": agents} if agents else told
    text = json.dumps({what: sorted(values) for what, values in all_of_it.items()}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def differences(a: Identity, b: Identity) -> list[Difference]:
    """Return in what two runs differ; nothing when they are of one kind."""
    found = []
    for what in dict.fromkeys([*a, *b]):
        if what.startswith(PARTS) and not (what in a and what in b):
            continue
        one, other = a.get(what, frozenset({NOT_TOLD})), b.get(what, frozenset({NOT_TOLD}))
        if one != other:
            found.append(Difference(what, (_words(one), _words(other))))
    return found


def odd_runs(runs: Sequence[RecordedRun]) -> list[tuple[RecordedRun, list[Difference]]]:
    """Return the runs that are not of the kind of most of them, each with its differences from the first of most.

    Where two kinds have as many runs, the kind of the earlier run stands for most.
    """
    kinds = [identity(run) for run in runs]
    usual = _usual(kinds)
    apart = [(run, differences(kind, usual)) for run, kind in zip(runs, kinds, strict=True)]
    return [(run, found) for run, found in apart if found]


def refusal(runs: Sequence[RecordedRun]) -> str | None:
    """Return why these runs are not of one kind, a sentence that names in what they differ; None when they are."""
    for run in runs:
        codes = identity(run)["the code"]
        if len(codes) > 1:
            return f"the episodes of {run.folder} were flown by different code ({_shown(codes)})"
    odd = odd_runs(runs)
    if not odd:
        return None
    run, found = odd[0]
    others = [each for each in runs if each.folder not in {folder.folder for folder, _ in odd}]
    single = "suite" not in run.configuration and "suite" in others[0].configuration
    alone = ", since it was not flown by a benchmark" if single else ""
    more = f"; {len(odd) - 1} more differ" if len(odd) > 1 else ""
    return (
        f"{run.folder} differs from {others[0].folder}, both of {run.pilot}, in {_listed(found)}{alone}{more}:"
        " runs of different kinds are not counted together"
    )


def _usual(kinds: Sequence[Identity]) -> Identity:
    """Return the first of the kind that most are of."""
    alike = [sum(not differences(kind, other) for other in kinds) for kind in kinds]
    return kinds[alike.index(max(alike))] if kinds else {}


def record_digest(record: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a record, however its file was laid out."""
    return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


def served(folder: Path) -> tuple[str, ...]:
    """Return the models that answered in an episode, in the vendors' words; empty: not told."""
    told = _of_episode(folder)
    return told.served if told else ()


def _of_episode(folder: Path) -> EpisodeIdentity | None:
    """Return an episode's identity.json; None where an older version wrote none, or it is damaged."""
    return taken(json_object(folder / layout.IDENTITY) or {}, EpisodeIdentity)[0]


def _of_run(configuration: Mapping[str, Any]) -> Iterator[tuple[str, frozenset[str]]]:
    flight = configuration.get("flight")
    asked = flight if isinstance(flight, dict) else {}
    for key, name in NAMES.items():
        told = configuration.get(key, NOT_TOLD)
        yield name, _value(agent_name(asked.get("agent") or told) if key == "agent" else told)
    protocol = configuration.get("protocol")
    yield "the protocol", frozenset({"told" if isinstance(protocol, dict) else NOT_TOLD})
    for name, value in _leaves(protocol if isinstance(protocol, dict) else {}):
        yield f"the protocol's {name}", _value(value)
    suite = configuration.get("suite")
    yield "the suite's version", _value(suite.get("version")) if isinstance(suite, dict) else frozenset({NOT_TOLD})
    if isinstance(suite, dict):
        yield f"the suite {suite.get('name') or 'of episodes by name'}", _value(suite.get("sha256"))
    for name, value in _leaves({key: value for key, value in asked.items() if key not in FREE}):
        yield name, _value(value)
    versions = configuration.get("versions")
    for package, version in (versions if isinstance(versions, dict) else {}).items():
        # a patch of Python changes no number
        told = ".".join(str(version).split(".")[:2]) if package == "python" else version
        yield f"the version of {package}", _value(told)


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (dotted name, value) of what a flight says; what is null was not asked for, and is as good as not there."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, f"{name}.{key}" if name else str(key))
    elif value is not None:
        yield name, value


def _value(value: Any) -> frozenset[str]:
    return frozenset({value if isinstance(value, str) else json.dumps(value, sort_keys=True)})


def _words(values: Iterable[str]) -> str:
    return " with ".join(sorted(values))


def _shown(values: Iterable[str]) -> str:
    return DIGEST.sub(r"\1", " and ".join(sorted(values)))


def _listed(found: Sequence[Difference]) -> str:
    each = [str(one) for one in found[:6]] + ([f"{len(found) - 6} more things"] if len(found) > 6 else [])
    return ", ".join(each[:-1]) + (" and " if len(each) > 1 else "") + each[-1]
