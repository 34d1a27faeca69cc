"""A flight spec can be pickled and stored as JSON without API keys. The file of a run repeats its flight."""

import argparse
import json
import pickle
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.latency import LatencyPolicy, trace_name
from dronecats.agent.models.spec import ModelSpec
from dronecats.cli import fly
from dronecats.cli.fly_spec import spec_of
from dronecats.cli.main import main, parse
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import Authority, Connected, FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_json, as_redacted_json, from_json, options_with_redacted_address
from episodes.records import catalogue
from foundation.errors import UsageError
from hil.cameras.lens import Calibration
from hil.link.envelope import SIMULATED, Limits

NUMBERS = st.floats(0.01, 100.0)
TEXTS = st.text(max_size=20)
OPTIONAL = st.none() | TEXTS
LENS = Calibration(640, 360, ((300.0, 0.0, 320.0), (0.0, 300.0, 180.0), (0.0, 0.0, 1.0)), (0.1, 0.0, 0.0, 0.0))
LATENCIES = st.sampled_from(
    [
        *map(LatencyPolicy.parse, ("fixed:0.50", "jitter:2,.5+cap:1", "tokens:0,9")),
        LatencyPolicy.parse(f"trace:{trace_name((0.25, 1.5))}", (0.25, 1.5)),
    ]
)
SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))

simulated = st.builds(
    Simulated, airframe=TEXTS, autopilot=st.just("px4"), px4=OPTIONAL,
    speed=st.none() | NUMBERS, rendered=st.booleans(),
    optics=st.none() | st.just({"haze": {"density_per_m": 0.02}}),
)  # fmt: skip
WORDS = TEXTS.filter(str.strip)
authorities = st.builds(
    lambda moves, then: Authority(arm=moves == "arm", then=then, dry=moves == "dry"),
    st.sampled_from(["arm", "dry", "neither"]), st.sampled_from(["land", "hold"]),
)  # fmt: skip
filmed = st.builds(Connected, url=TEXTS, camera=WORDS, calibration=st.none() | st.just(LENS), authority=authorities)
drawn = st.builds(Connected, url=TEXTS, truth=TEXTS, authority=authorities)
models = st.builds(
    ModelSpec, provider=WORDS, name=WORDS, base_url=st.none() | WORDS, axis_order=st.sampled_from(["xy", "yx"]),
    temperature=st.floats(0.0, 2.0), schema=st.sampled_from([None, "object", "array"]),
    thinking=st.none() | st.just({"a": [1]}),
)  # fmt: skip


commands = st.one_of(
    st.fixed_dictionaries({"command": st.sampled_from(["flat", "solo", "hierarchical"])}),
    st.fixed_dictionaries({"command": st.just("hierarchical"), "commander": models}),
    st.fixed_dictionaries({"command": st.just("hierarchical"), "scripted": TEXTS}),
)


@st.composite
def specs(draw):
    vehicle = draw(st.sampled_from(["simulated", "connected"]))
    pilot = draw(st.sampled_from(["pilot", "model"]))
    place = draw(st.sampled_from(["episode", "map", "record", "instruction"]))
    chosen: dict[str, Any] = {
        vehicle: draw(simulated if vehicle == "simulated" else filmed if place == "instruction" else drawn),
        pilot: draw(TEXTS if pilot == "pilot" else models),
        place: {"id": draw(TEXTS)} if place == "record" else draw(WORDS),
    }
    return FlightSpec(
        **chosen,
        parser=draw(st.sampled_from(["strict", "lenient"])),
        prompt=draw(OPTIONAL), latency=draw(LATENCIES), patience_s=draw(st.none() | st.floats(1.0, 300.0)),
        drones=draw(st.none() | st.integers(1, 8)) if vehicle == "simulated" else None,
        **draw(commands if vehicle == "simulated" else st.just({})),
        seed=draw(st.integers(0, 2**31 - 1)), seconds=draw(NUMBERS), full=draw(st.booleans()),
        envelope=draw(st.sampled_from([Limits(), SIMULATED, Limits(exclusions=(SQUARE,), battery_min=None)])),
    )  # fmt: skip


@given(specs())
def test_a_flight_spec_round_trips_through_pickle_and_json(spec):
    assert pickle.loads(pickle.dumps(spec)) == spec
    assert from_json(json.loads(json.dumps(as_json(spec))), "here") == spec


def test_invalid_flights_are_rejected(tmp_path, capsys):
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"sed": 1}, "'sed'"),
        ({"simulated": {"sped": 1.0}}, "'simulated.sped'"),
        ({"seed": "1"}, "seed"),
        ({"seed": True}, "seed"),
        ({"pilot": None}, "pilot, model or outside"),
        ({"connected": {"url": "x"}}, "simulated or connected"),
        ({"map": "blocks"}, "episode, record and map"),
        ({"simulated": {"autopilot": "ardupilot"}}, "autopilot"),
        ({"command": "chain"}, "command"),
        ({"scripted": "scripted:divide"}, "hierarchical"),
        ({"command": "hierarchical", "scripted": "x", "commander": {"provider": "local", "name": "m"}}, "commander"),
    ]
    for change, word in wrong:
        file = tmp_path / "spec.json"
        file.write_text(json.dumps({"pilot": "oracle", "simulated": {}, "episode": catalogue.DEFAULT, **change}))
        assert main(["fly", "--spec", str(file)]) == 2, change
        error = capsys.readouterr().err
        assert word in error, change
        assert str(file) in error, change


SHOWN, TRUE = {"camera": "c"}, {"truth": "udpin://x:2"}


@pytest.mark.parametrize(
    ("vehicle", "flight", "word"),
    [
        ({}, {"instruction": "go"}, "--camera"),
        (SHOWN, {}, "--instruction"),
        (SHOWN, {"map": "blocks", "instruction": "go"}, "--truth"),
        (TRUE, {"instruction": "go"}, "--world"),
        ({**TRUE, **SHOWN}, {"episode": catalogue.DEFAULT}, "--camera"),
        ({**SHOWN, "authority": Authority(dry=True)}, {"instruction": "go"}, "--dry-run"),
    ],
    ids=["no picture", "no task", "no truth", "no world", "two pictures", "moves nothing, and arms"],
)
def test_contradictory_options_of_a_connected_flight_are_rejected(vehicle, flight, word):
    FlightSpec(pilot="vision", connected=Connected(url="x", camera="c"), instruction="go")
    FlightSpec(pilot="vision", connected=Connected(url="x", truth="udpin://x:2"), episode=catalogue.DEFAULT)
    with pytest.raises(UsageError, match=word):
        FlightSpec(pilot="vision", connected=Connected(url="x", **vehicle), **flight)


def test_stored_flights_hold_no_secrets():
    model = ModelSpec(provider="local", name="m", base_url="https://h.example/v1/sk-0123456789abcdef?token=T0PSECRET")
    real = Connected(url="udpin://0.0.0.0:14540", camera="rtsp://me:pw777@cam/1")
    spec = FlightSpec(model=model, connected=real, envelope=Limits(), instruction="go")
    kept = as_redacted_json(spec)
    text = json.dumps(kept)
    assert all(secret not in text for secret in ("0123456789abcdef", "T0PSECRET", "pw777"))
    assert options_with_redacted_address(from_json(kept, "run.json")) == ["--base-url", "--camera"]
    above = FlightSpec(pilot="vision", command="hierarchical", commander=model, simulated=Simulated())
    assert "0123456789abcdef" not in json.dumps(as_redacted_json(above))
    assert options_with_redacted_address(from_json(as_redacted_json(above), "run.json")) == ["--commander-url"]
    assert options_with_redacted_address(spec) == []
    assert from_json(as_json(spec), "pipe") == spec


def test_a_run_repeats_from_its_file_to_the_same_bytes(tmp_path, capsys):
    options = ["--pilot", "oracle", "--speed", "max", "--seed", "4", "--latency", "lognormal:0.4,0.6"]
    first, again = tmp_path / "first", tmp_path / "again"
    assert main(["fly", "--sitl", *options, "--episode", "residential-searching-02", "--out", str(first)]) == 0
    assert main(["fly", "--spec", str(first / "run.json"), "--out", str(again)]) == 0
    logs = [f"residential-searching-02/{name}" for name in ("truth.jsonl", "decisions.jsonl", "verdict.json")]
    assert all((first / log).read_bytes() == (again / log).read_bytes() for log in logs)
    assert json.loads((first / "run.json").read_text()) == json.loads((again / "run.json").read_text())
    latencies = {
        json.loads(line)["latency_s"] for line in (first / logs[1]).read_text().splitlines()
    }  # each question has its own
    assert len(latencies) > 3
    assert main(["fly", "--spec", str(first / "run.json"), "--seed", "5"]) == 2
    assert "--seed" in capsys.readouterr().err


def test_a_flight_spec_holds_a_custom_record_and_not_its_file_name(tmp_path):
    mine = replace(catalogue.load(catalogue.DEFAULT), id="mine", seed=77)
    spec = FlightSpec(pilot="oracle", simulated=Simulated(speed=None), record=json.loads(mine.to_json()))
    assert look_up(spec).record == mine
    assert look_up(spec).seed == (77, 0)
    with pytest.raises(UsageError, match="record"):
        look_up(replace(spec, record={"id": "mine"}))


def test_a_spec_file_without_an_episode_requires_the_episode_option(tmp_path, capsys):
    spec = FlightSpec(pilot="oracle", simulated=Simulated(speed=None))
    file = tmp_path / "run.json"
    file.write_text(json.dumps({"flight": as_redacted_json(spec), "versions": {}}))
    assert main(["fly", "--spec", str(file)]) == 2
    assert "--episode" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [("--base-url", "http://h/v1"), ("--commander-url", "http://h/v1"), ("--camera", "http://h"),
              ("--target", "1,2"), ("--target", "1,2", "--target-std", "1"), ("--target-std", "1")],
)  # fmt: skip
def test_options_that_do_not_apply_to_the_flight_of_a_spec_file_are_rejected(tmp_path, words):
    file = tmp_path / "run.json"
    file.write_text(json.dumps(as_json(FlightSpec(pilot="oracle", episode=catalogue.DEFAULT, simulated=Simulated()))))
    with pytest.raises(UsageError, match=words[0]):
        spec_of(parse(["fly", "--spec", str(file), *words]))


def test_the_error_for_an_older_run_differs_from_that_for_a_wrong_file(tmp_path, capsys):
    file = tmp_path / "run.json"
    file.write_text(json.dumps({"pilot": "oracle", "versions": {"dronecats": "0.1.0"}}))
    assert main(["fly", "--spec", str(file)]) == 2
    assert "version" in capsys.readouterr().err


@pytest.mark.parametrize(
    "vehicle", [["--sitl"], ["--connect", "udpin://127.0.0.1:1", "--camera", "x", "--instruction", "go"]]
)
def test_the_parser_option_selects_how_replies_are_parsed(vehicle):
    command = argparse.ArgumentParser()
    fly.add_fly_options(command)

    def parser_name(*words):
        return spec_of(command.parse_args([*vehicle, *words])).parser

    assert (parser_name(), parser_name("--parser", "lenient"), parser_name("--parser", "strict")) == (
        "strict",
        "lenient",
        "strict",
    )
