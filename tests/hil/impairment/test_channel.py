"""The model of an impaired link: no invented data, results determined by the seed, and a limited data rate."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.impairment import LATE_S, Channel, Impairment
from tests.support.refusal import refusal

SHARES = st.floats(0.0, 1.0)
WIRES = st.builds(
    Impairment,
    loss=SHARES,
    delay_s=st.floats(0.0, 2.0),
    jitter_s=st.floats(0.0, 1.0),
    duplicate=SHARES,
    reorder=SHARES,
    corrupt=st.sampled_from([0.0, 0.0, 0.01]),
    baud=st.sampled_from([None, 1200, 57600]),
    cuts=st.sampled_from([(), ((1.0, 2.0),)]),
)
TRAFFIC = st.lists(st.tuples(st.floats(0.0, 0.2), st.integers(12, 280)), max_size=60)


def carried(wire: Impairment, seed: int, traffic: list[tuple[float, int]]) -> tuple[list[tuple[float, bytes]], Channel]:
    """Return the arrivals with their times (s), and the channel. Unit n consists of the byte n."""
    channel, t_s, out = Channel(wire, seed), 0.0, []
    for n, (pause_s, length) in enumerate(traffic):
        t_s += pause_s
        out += [(t_s, unit) for unit in channel.arrived(t_s)]
        channel.put(t_s, bytes([n]) * length)
    while channel.next_s is not None:
        t_s = max(t_s, channel.next_s)
        out += [(t_s, unit) for unit in channel.arrived(t_s)]
    return out, channel


@given(WIRES, st.integers(0, 2**31), TRAFFIC)
def test_the_same_seed_and_the_same_times_give_the_same_arrivals(wire: Impairment, seed: int, traffic) -> None:
    assert carried(wire, seed, traffic)[0] == carried(wire, seed, traffic)[0]


@given(WIRES, st.integers(0, 9), TRAFFIC)
def test_the_counters_account_for_every_unit(wire: Impairment, seed: int, traffic) -> None:
    out, channel = carried(wire, seed, traffic)
    counts = channel.counts
    assert counts.taken == len(traffic)
    assert counts.arrived == len(out) == counts.taken - counts.lost - counts.cut - counts.overflowed + counts.duplicated
    assert counts.bytes_arrived == sum(len(unit) for _, unit in out)


@given(st.integers(0, 99), TRAFFIC, SHARES, SHARES)
def test_a_higher_loss_share_loses_a_superset_of_the_units(seed: int, traffic, a: float, b: float) -> None:
    little, much = (
        {unit[0] for _, unit in carried(Impairment(loss=loss), seed, traffic)[0]} for loss in sorted((a, b))
    )
    assert much <= little


@given(WIRES, st.integers(0, 9), TRAFFIC)
def test_units_arrive_in_order_and_after_the_delay_without_reordering(wire: Impairment, seed: int, traffic) -> None:
    calm = Impairment(loss=wire.loss, delay_s=wire.delay_s, jitter_s=wire.jitter_s, baud=wire.baud, cuts=wire.cuts)
    entered, t_s = {}, 0.0
    for n, (pause_s, _) in enumerate(traffic):
        t_s += pause_s
        entered[n] = t_s
    out = carried(calm, seed, traffic)[0]
    assert [unit[0] for _, unit in out] == sorted(unit[0] for _, unit in out)
    assert all(when >= entered[unit[0]] + wire.delay_s - 1e-9 for when, unit in out)


@settings(max_examples=30)
@given(st.sampled_from([1200, 9600, 57600]), st.integers(0, 9), TRAFFIC)
def test_the_throughput_does_not_exceed_the_baud_rate(baud: int, seed: int, traffic) -> None:
    channel = Channel(Impairment(baud=baud), seed)
    for _, length in traffic:
        channel.put(0.0, bytes(length))
    assert len(list(channel.arrived(1.0))) <= len(traffic)
    assert channel.counts.bytes_arrived <= baud / 10 + 1e-6


def test_a_full_queue_drops_new_units() -> None:
    channel = Channel(Impairment(baud=1000, queue_bytes=300), seed=0)
    for _ in range(4):
        channel.put(0.0, bytes(100))
    assert channel.counts.overflowed == 1
    channel.put(1.0, bytes(100))  # 100 bytes have left the queue by now
    assert channel.counts.overflowed == 1
    assert len(list(channel.arrived(4.0))) == 4


def test_a_serial_line_takes_ten_bits_per_byte() -> None:
    channel = Channel(Impairment(baud=57600), seed=0)
    channel.put(0.0, bytes(576))
    assert channel.next_s == pytest.approx(0.1)


def test_a_cut_loses_the_units_that_enter_and_those_in_transit() -> None:
    channel = Channel(Impairment(delay_s=0.5, cuts=((1.0, 2.0),)), seed=0)
    for t_s in (0.4, 0.6, 1.5, 2.0):
        channel.put(t_s, bytes(20))
    assert channel.counts.cut == 2
    assert [round(channel.next_s or 0.0, 3), len(list(channel.arrived(9.0)))] == [0.9, 2]


def test_reordering_changes_the_order_and_duplication_adds_units() -> None:
    out = carried(Impairment(reorder=0.5, duplicate=0.5), 3, [(LATE_S / 10, 20)] * 40)[0]
    order = [unit[0] for _, unit in out]
    assert order != sorted(order)
    assert len(order) > 40


def test_loss_duplicate_and_reorder_shares_match_the_settings() -> None:
    counts = carried(Impairment(loss=0.1, duplicate=0.2, reorder=0.3), 1, [(0.01, 20)] * 200)[1].counts
    assert 8 <= counts.lost <= 35
    assert 20 <= counts.duplicated <= 55
    assert 35 <= counts.reordered <= 80


def test_corruption_changes_bytes_but_not_lengths() -> None:
    out, channel = carried(Impairment(corrupt=0.01), 1, [(0.01, 100)] * 100)
    assert all(len(unit) == 100 for _, unit in out)
    assert 40 <= channel.counts.corrupted <= 90
    assert sum(set(unit) != {n} for n, (_, unit) in enumerate(out)) == channel.counts.corrupted


def test_invalid_wires_are_rejected() -> None:
    wrong: list[dict[str, Any]] = [
        {"loss": 1.5},
        {"loss": float("nan")},
        {"delay_s": -1.0},
        {"baud": 10},
        {"queue_bytes": 3},
        {"cuts": ((2.0, 1.0),)},
    ]
    for fields in wrong:
        assert refusal(Impairment, **fields)
