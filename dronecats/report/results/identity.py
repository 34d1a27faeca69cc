"""Decides which runs may be counted together: the identity of a run, and the differences between two runs.

Two runs are of one kind if their identities do not differ. The identity has the settings and versions in run.json. It
has no measured values and no fields that may differ between runs of one kind, such as the seed. A value that an older
run did not record equals only another missing value.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from dronecats.agent.names import FORMER, agent_name
from dronecats.report.recorded.run import RecordedRun
from foundation.run_folder import layout
from foundation.run_folder.folder import comparable_versions
from foundation.run_folder.reading import json_object, parse_row
from foundation.run_folder.rows import EpisodeIdentity

RECORDED, NOT_RECORDED = "told", "not told"  # stored values: digests in archives include them, so they must not change
# value of an identity → its text in a sentence
WORDS = {NOT_RECORDED: "not recorded", RECORDED: "recorded", "null": "none", "{}": "nothing"}
KEYS_SHOWN = 4  # a sentence lists at most this many keys of a JSON object
NAMES = {  # key of run.json → its name in a sentence
    "code_sha256": "the code",
    "prompt_sha256": "the prompt",
    "commander_prompt_sha256": "the commander's prompt",
    "agent": "the agent",
    "clock": "the clock",
    "camera": "the camera",
    "map_sha256": "the map",
    "firmware": "the firmware",
}
# Fields of a flight that are not compared. The prompt is compared by its digest, the agent by its name, recorded
# latencies by their policy
IGNORED_FIELDS = ("seed", "episode", "record", "accounts", "prompt", "agent", "latency_trace", "keep_ulog")
OPTIONAL_PREFIXES = ("the suite ", "the protocol's ")  # names with this prefix: compared only if both runs have them
DIGEST = re.compile(r"\b([0-9a-f]{8})[0-9a-f]{24,}\b")

Identity = Mapping[str, frozenset[str]]  # name of a setting → its values in the run, mostly one


@dataclass(frozen=True, slots=True)
class Difference:
    """One difference between two runs."""

    name: str  # "the prompt", "latency", "the version of numpy"
    values: tuple[str, ...]  # values of the two runs, in words

    def __str__(self) -> str:
        return f"{self.name} ({' and '.join(_in_words(self.values))})"


def _in_words(values: Sequence[str]) -> list[str]:
    """Return the values of an identity as readable text. For JSON objects, the text has only the keys that differ."""
    parsed = [_parsed(value) for value in values]
    if not any(isinstance(value, dict) for value in parsed):
        return [WORDS.get(value, DIGEST.sub(r"\1", value)) for value in values]
    tables = [dict(_set_leaves(value)) if isinstance(value, dict) else {} for value in parsed]
    keys = [key for key in dict.fromkeys(chain(*tables)) if len({str(table.get(key)) for table in tables}) > 1]
    more = [f"{len(keys) - KEYS_SHOWN} more"] if len(keys) > KEYS_SHOWN else []
    return [
        ", ".join([*(f"{key} {table[key]}" for key in keys[:KEYS_SHOWN] if key in table), *more])
        if table
        else WORDS.get(value, value)
        for table, value in zip(tables, values, strict=True)
    ]


def _parsed(value: str) -> Any:
    try:
        return json.loads(value)
    except ValueError:
        return value


def identity(run: RecordedRun) -> dict[str, frozenset[str]]:
    values = dict(_run_values(run.configuration))
    episodes = [episode for folder in run.episodes if (episode := _episode_identity(folder)) is not None]
    codes = {episode.code_sha256 for episode in episodes}
    values["the code"] = frozenset(codes) | (values["the code"] - {NOT_RECORDED} if codes else values["the code"])
    served = {name for episode in episodes for name in episode.served}
    values["the model as served"] = frozenset(served) or frozenset({NOT_RECORDED})
    return values


def identity_digest(values: Identity) -> str:
    """Return the SHA-256 of an identity."""
    # uses the agents' names of version 0.1.0, so that digests in archives of that version stay valid
    former = {name: made for made, name in FORMER.items()}
    agents = frozenset(former.get(name, name.replace(":", ".")) for name in values.get("the agent", ()))
    packed = {**values, "the agent": agents} if agents else values
    text = json.dumps({name: sorted(entries) for name, entries in packed.items()}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def differences(a: Identity, b: Identity) -> list[Difference]:
    """Return the differences between two identities; empty: the runs are of one kind."""
    differing = []
    for name in dict.fromkeys([*a, *b]):
        if name.startswith(OPTIONAL_PREFIXES) and not (name in a and name in b):
            continue
        value, other_value = a.get(name, frozenset({NOT_RECORDED})), b.get(name, frozenset({NOT_RECORDED}))
        if value != other_value:
            differing.append(Difference(name, (_words(value), _words(other_value))))
    return differing


def deviating_runs(runs: Sequence[RecordedRun]) -> list[tuple[RecordedRun, list[Difference]]]:
    """Return the runs that are not of the most frequent kind, each with its differences from a run of that kind.

    If two kinds are equally frequent, the kind of the earlier run counts.
    """
    kinds = [identity(run) for run in runs]
    usual = _most_frequent_kind(kinds)
    apart = [(run, differences(kind, usual)) for run, kind in zip(runs, kinds, strict=True)]
    return [(run, differing) for run, differing in apart if differing]


def pooling_conflict(runs: Sequence[RecordedRun]) -> str | None:
    """Return a sentence about the differences between runs of several kinds; None: all runs are of one kind."""
    for run in runs:
        codes = identity(run)["the code"]
        if len(codes) > 1:
            return f"the episodes of {run.folder} were flown by different code ({_shown(codes)})"
    odd = deviating_runs(runs)
    if not odd:
        return None
    run, differing = odd[0]
    odd_folders = {odd_run.folder for odd_run, _ in odd}
    usual = next(candidate for candidate in runs if candidate.folder not in odd_folders)
    single = "suite" not in run.configuration and "suite" in usual.configuration
    alone = ", because a benchmark did not fly it" if single else ""
    more = f"; {len(odd) - 1} more differ" if len(odd) > 1 else ""
    return (
        f"{run.folder} differs from {usual.folder}, both of {run.pilot}, in {_listed(differing)}{alone}{more}."
        " Runs with different settings are not counted together"
    )


def _most_frequent_kind(kinds: Sequence[Identity]) -> Identity:
    """Return the first identity of the most frequent kind."""
    counts = [sum(not differences(kind, compared) for compared in kinds) for kind in kinds]
    return kinds[counts.index(max(counts))] if kinds else {}


def record_digest(record: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a record, independent of the layout of its file."""
    return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


def served(folder: Path) -> tuple[str, ...]:
    """Return the models that answered in an episode, as the vendors name them; empty: not recorded."""
    episode = _episode_identity(folder)
    return episode.served if episode else ()


def _episode_identity(folder: Path) -> EpisodeIdentity | None:
    """Return an episode's identity.json; None: it is damaged, or missing because an older version flew."""
    return parse_row(json_object(folder / layout.IDENTITY) or {}, EpisodeIdentity)[0]


def _run_values(configuration: Mapping[str, Any]) -> Iterator[tuple[str, frozenset[str]]]:
    flight = configuration.get("flight")
    flight_fields = flight if isinstance(flight, dict) else {}
    for key, name in NAMES.items():
        value = configuration.get(key, NOT_RECORDED)
        yield name, _value(agent_name(flight_fields.get("agent") or value) if key == "agent" else value)
    protocol = configuration.get("protocol")
    yield "the protocol", frozenset({RECORDED if isinstance(protocol, dict) else NOT_RECORDED})
    for name, leaf in _set_leaves(protocol if isinstance(protocol, dict) else {}):
        yield f"the protocol's {name}", _value(leaf)
    suite = configuration.get("suite")
    yield "the suite's version", _value(suite.get("version")) if isinstance(suite, dict) else frozenset({NOT_RECORDED})
    if isinstance(suite, dict):
        yield f"the suite {suite.get('name') or 'of episodes by name'}", _value(suite.get("sha256"))
    for name, leaf in _set_leaves({key: leaf for key, leaf in flight_fields.items() if key not in IGNORED_FIELDS}):
        yield name, _value(leaf)
    versions = configuration.get("versions")
    for package, version in comparable_versions(versions if isinstance(versions, dict) else {}).items():
        yield f"the version of {package}", _value(version)


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (dotted name, value) of each leaf of a JSON object, such as ("reasoning.enabled", False)."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from leaves(inner, f"{name}.{key}" if name else str(key))
    else:
        yield name, value


def _set_leaves(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the leaves of a JSON object that are not null (not requested)."""
    return ((name, leaf) for name, leaf in leaves(value) if leaf is not None)


def _value(value: Any) -> frozenset[str]:
    return frozenset({value if isinstance(value, str) else json.dumps(value, sort_keys=True)})


def _words(values: Iterable[str]) -> str:
    return " with ".join(sorted(values))


def _shown(values: Iterable[str]) -> str:
    return DIGEST.sub(r"\1", " and ".join(sorted(values)))


def _listed(differing: Sequence[Difference]) -> str:
    names = [str(difference) for difference in differing[:6]]
    names += [f"{len(differing) - 6} more"] if len(differing) > 6 else []
    return ", ".join(names[:-1]) + (" and " if len(names) > 1 else "") + names[-1]
