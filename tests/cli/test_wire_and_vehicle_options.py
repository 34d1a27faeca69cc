"""Disturbances of the link and the vehicle, as options of `fly` and of a bench.toml."""

import argparse
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from dronecats.cli.bench_spec import FILE_OPTIONS
from dronecats.cli.fly_spec import spec_of
from dronecats.cli.main import parse
from dronecats.cli.options import add_disturbances
from dronecats.flight.spec.disturbances import DECLARED, UNDISTURBED, Disturbances, LinkFaults, VehicleFaults
from dronecats.study.factors import FACTORS
from foundation.declaration import declarations
from foundation.errors import UsageError
from hil.impairment import Impairment


def parsed(*words: str) -> Disturbances:
    parser = argparse.ArgumentParser()
    add_disturbances(parser)
    return UNDISTURBED.with_options(vars(parser.parse_args(words)))


def wire(text: str) -> LinkFaults:
    return parsed("--link", text).link


def test_one_direction_of_a_link_option_overrides_both() -> None:
    both = Impairment(delay_s=0.1, loss=0.05, baud=57_600)
    assert wire("delay=0.1,loss=0.05,baud=57600") == LinkFaults(to_vehicle=both, from_vehicle=both)
    assert wire("to.loss=1,delay=0.2,from.delay=0.3, to.queue=4096,to.baud=300") == LinkFaults(
        to_vehicle=Impairment(delay_s=0.2, loss=1.0, queue_bytes=4096, baud=300), from_vehicle=Impairment(delay_s=0.3)
    )
    assert wire("queue=4096,from.baud=300").from_vehicle == Impairment(queue_bytes=4096, baud=300)
    every = "jitter=0.1,duplicate=0.2,reorder=0.3,corrupt=0.01"
    assert wire(every).from_vehicle == Impairment(jitter_s=0.1, duplicate=0.2, reorder=0.3, corrupt=0.01)


def test_every_option_reaches_its_field() -> None:
    disturbances = parsed(
        "--wind=-4,3", "--gusts", "7.7", "--payload", "0.5", "--gps-delay", "0.2", "--gps-noise", "3", "--sensor-noise",
        "2", "--setpoint-rate", "5", "--host-stalls", "0.1,0.6", "--link", "loss=0.1",
    )  # fmt: skip
    assert disturbances == Disturbances(
        link=LinkFaults(to_vehicle=Impairment(loss=0.1), from_vehicle=Impairment(loss=0.1)),
        vehicle=VehicleFaults(
            wind_ned=(-4.0, 3.0, 0.0), gusts_w20=7.7, payload_kg=0.5, gps_delay_s=0.2, gps_noise=3.0,
            estimator_noise=2.0, setpoint_hz=5.0, stalled=0.1, stall_s=0.6,
        ),
    )  # fmt: skip
    assert parsed() == Disturbances()


def test_invalid_values_are_rejected_in_one_sentence() -> None:
    for words, parts in (
        ("--link los=0.1", "--link .*NAME=VALUE.* delay,"),
        ("--link delay", "'delay'"),
        ("--link .delay=1", r"'\.delay=1'"),
        ("--link via.delay=1", r"'via\.delay=1'"),
        ("--link delay=fast", "'delay=fast'"),
        ("--link baud=1e5", "'baud=1e5'"),
        ("--link loss=2", "loss .*0 .*1"),
        ("--link delay=nan", "delay .*0 .*60 "),
        ("--link loss=1", r"to\.loss=1"),
        ("--link delay=0.1,loss=0.1,delay=0.2", r"delay .*twice.*'delay=0\.2'"),
        ("--link to.delay=0.1, to.delay=0.1", r"to\.delay .*twice"),
        ("--link queue=4096", "queue .*no effect.*baud"),
        ("--link from.queue=4096,to.baud=300", r"from\.queue .*no effect.*from\.baud"),
        ("--wind 4", "--wind .*N,E"),
        ("--wind nan,0", "--wind .*N,E"),
        ("--wind 30,30", "wind .*0 .*30 m/s"),
        ("--gusts 31", "gusts .*0 .*30 m/s"),
        ("--payload -1", "payload .*0 .*20 kg"),
        ("--gps-delay 2", r"gps_delay .*0 .*1\.4 s"),
        ("--setpoint-rate 1", "setpoint_rate .*2 .*50 Hz"),
        ("--host-stalls 0.1", "--host-stalls .*0.1"),
        ("--host-stalls 2,1", "stall_share .*0 .*1"),
    ):
        with pytest.raises(UsageError) as raised:
            parsed(*words.split(" ", 1))
        assert re.search(parts, str(raised.value)), raised.value
        assert "\n" not in str(raised.value), words


def test_host_stalls_are_rejected_in_lockstep() -> None:
    with pytest.raises(UsageError, match=r"--host-stalls .*--speed"):
        spec_of(parse(["fly", "--sitl", "--speed", "max", "--host-stalls", "0.1,0.5"]))


def test_the_description_contains_the_values() -> None:
    for words, values in (
        (("--link", "delay=0.1,loss=0.05,baud=57600"), ["0.1", "5", "57600", "2048"]),
        (("--link", "to.jitter=0.1,from.reorder=0.2"), ["0.1", "20"]),
        (("--gps-delay", "0.2", "--gps-noise", "3"), ["0.2", "3"]),
        (("--host-stalls", "0.1,0.5"), ["0.5", "10"]),
    ):
        assert re.findall(r"\d[\d.]*", parsed(*words).words or "") == values, words


def test_each_disturbance_has_its_own_description() -> None:
    descriptions = [UNDISTURBED.words]
    wires: dict[str, Any] = {
        "loss": 0.1, "delay_s": 0.1, "jitter_s": 0.1, "duplicate": 0.1, "reorder": 0.1, "corrupt": 0.1, "baud": 300,
        "cuts": ((1.0, 2.0),),
    }  # fmt: skip
    assert {*wires, "queue_bytes"} == {field.name for field in fields(Impairment)}
    for name, value in wires.items():
        bad = Impairment(**{name: value})
        descriptions += [Disturbances(link=LinkFaults(**{way: bad})).words for way in ("to_vehicle", "from_vehicle")]
    faults: dict[str, Any] = {
        name: declaration.quantity.high
        for name, declaration in declarations(VehicleFaults).items()
        if name not in ("wind_ned", "stall_s")
    } | {"wind_ned": (0.0, 0.0, 1.0)}
    assert {*faults, "stall_s"} == {field.name for field in fields(VehicleFaults)}
    descriptions += [Disturbances(vehicle=VehicleFaults(**{name: value})).words for name, value in faults.items()]
    assert len(set(descriptions)) == 1 + 2 * len(wires) + len(faults)


def test_each_declaration_has_an_option_a_file_key_a_factor_and_a_documented_option() -> None:
    page = (Path(__file__).parents[2] / "docs" / "disturbances.md").read_text(encoding="utf-8")
    for part, field, declared in DECLARED:
        option, number = declared.option, declared.quantity
        if option is not None:
            assert option.name in FILE_OPTIONS
            assert f"--{option.name.replace('_', '-')} {option.metavar}" in page
        for level in declared.levels:
            factor = FACTORS[level.name]
            assert factor.quantity == level or factor.words == getattr(level, "words", None)
        if option is None or option.read or number is None:
            continue
        for beyond in (number.low - 1.0, number.high + 1.0):
            with pytest.raises(UsageError, match=f"^{number.name} .*{beyond:g}"):
                parsed(f"--{option.name.replace('_', '-')}={beyond}")
        within = parsed(f"--{option.name.replace('_', '-')}={number.high}")
        assert getattr(getattr(within, part), field) == number.high
