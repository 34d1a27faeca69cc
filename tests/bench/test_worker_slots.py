"""Distribution of flights on one machine: all workers equally busy, each with as few maps as possible."""

from pathlib import Path

from dronecats.bench.engine import LocalEngine

C, R = "campus", "residential"


def shared_out(jobs, workers, maps):
    """Return the worker of each flight when all of them begin at once."""
    engine = LocalEngine(Path("log"), jobs, workers=workers)
    return [begin(engine, name) for name in maps]


def begin(engine, name):
    """Give a flight on this map to a worker without starting it; return the worker."""
    crew = engine._crew_for(name)
    crew.fresh.append(name)
    return engine._crews.index(crew)


def test_flights_of_one_map_are_distributed_evenly():
    for jobs, workers, flights, expected in (
        (1, 2, 1, [1]), (2, 2, 2, [1, 1]), (16, 2, 16, [8, 8]), (16, 2, 1, [1]), (5, 2, 5, [3, 2]),
        (3, 8, 3, [1, 1, 1]),
    ):  # fmt: skip
        slots = shared_out(jobs, workers, [R] * flights)
        assert [slots.count(k) for k in sorted(set(slots))] == expected, (jobs, workers, flights)


def test_every_worker_has_one_map_if_the_load_stays_even():
    for maps in ([C] * 4 + [R] * 4, [C, R] * 4, [C, C, R, R] * 2):
        slots = shared_out(8, 2, maps)
        assert {name: {k for k, each in zip(slots, maps, strict=True) if each == name} for name in (C, R)} == {
            C: {0}, R: {1},
        }, maps  # fmt: skip


def test_an_even_load_is_preferred_to_one_map_per_worker():
    slots = shared_out(8, 2, [C] * 7 + [R])
    assert slots.count(0) == slots.count(1) == 4


def test_later_flights_go_to_a_free_worker_with_their_map():
    engine = LocalEngine(Path("log"), 4, workers=2)
    assert [begin(engine, name) for name in (C, C, R, R)] == [0, 0, 1, 1]
    campus, residential = engine._crews
    campus.fresh.pop()
    residential.fresh.pop()
    assert begin(engine, R) == 1
    assert begin(engine, R) == 0  # only this worker has room
    residential.fresh.pop()
    assert begin(engine, R) == 1
