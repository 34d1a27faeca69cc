"""Editing without a browser: after every operation the record is valid, and its things stand on the ground."""

import itertools
import math
from dataclasses import replace
from functools import partial

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dronecats.view.editor.draft import HEIGHT_M, Drafting
from dronecats.view.editor.editor import Session
from episodes import maps
from episodes.authoring.check.finding import GRID_SIDE_M, NEAREST_PAIR_M, WIDEST_PAIR_M
from episodes.maps import assets
from episodes.records import catalogue, record
from episodes.records.record import CELLS, HIDDEN, MOVING
from episodes.world.target import motion
from episodes.world.world import World
from foundation.errors import UsageError
from foundation.protocol import CAP_S


@pytest.fixture(scope="module")
def drafting():
    return Drafting(maps.build("residential"))


@pytest.fixture
def draft(drafting):
    return drafting.new("residential")


def sound(drafting, draft) -> None:
    """Assert the properties that every draft has after any operation."""
    one = draft.record
    assert record.parse(one.to_json(), "draft") == one
    for start in one.starts:
        assert drafting.height(start) > 0.0
    things = [one.target, *one.candidates] if one.target.native is None else list(one.candidates)
    for thing in things:
        (north, east, down), _ = motion(thing).pose(0.0)
        assert down == pytest.approx(drafting.scene.terrain.at(north, east), abs=0.01)
    centre = drafting.centre(one)
    assert one.start_distance_m == pytest.approx(math.dist(one.starts[0].position_ned, centre), abs=1e-3)
    assert one.visible_at_start == (one.cell not in HIDDEN)


def test_a_new_draft_can_be_flown(drafting, draft):
    sound(drafting, draft)
    world = World(draft.record)
    assert world.target_centre(0.0) == pytest.approx(drafting.centre(draft.record))
    assert draft.record.instruction == "go to the cyan SUV"
    assert drafting.height(draft.record.starts[0]) == pytest.approx(HEIGHT_M, abs=1e-3)


@pytest.mark.parametrize("name", catalogue.ids()[::7])
def test_opening_an_episode_does_not_change_it(name):
    one = catalogue.load(name)
    drafting = Drafting(maps.build(one.map, one.map_seed))
    opened = drafting.opened(one)
    assert opened.record == one
    with_derived_fields = drafting.with_derived_fields(opened).record
    assert with_derived_fields.start_distance_m == pytest.approx(one.start_distance_m, abs=0.01)
    assert math.remainder(with_derived_fields.bearing_deg - one.bearing_deg, 360.0) == pytest.approx(0.0, abs=0.1)


def test_a_moved_target_stays_on_the_ground(drafting, draft):
    for north, east in ((10.0, 3.0), (-20.5, 12.0), (33.25, -9.5)):
        draft = drafting.move_target(draft, north, east, 400.0)
        assert draft.record.target.position_ned[:2] == (north, east)
        assert draft.record.target.yaw_deg == 40.0
        sound(drafting, draft)


def test_the_instruction_follows_asset_and_paint_until_the_user_edits_it(drafting, draft):
    draft = drafting.choose(draft, "van", "orange")
    assert draft.record.instruction == "go to the orange van"
    draft = drafting.choose(drafting.instruct(draft, "  fetch  me\nthat van "), "sedan", "blue")
    assert draft.record.instruction == "fetch me that van"
    assert drafting.instruct(draft, "").record.instruction == "go to the blue sedan"


@pytest.mark.parametrize("a", CELLS)
def test_a_draft_can_change_from_any_cell_to_any_other(drafting, draft, a):
    before = drafting.cell(draft, a)
    for b in CELLS:
        after = drafting.cell(before, b)
        sound(drafting, after)
        one = after.record
        assert (one.target.path is not None) == (b in MOVING), b
        assert len(one.starts) == (4 if b == "commanding" else 1), b
        assert len(one.candidates) == (3 if b == "commanding" else 0), b
        if b in HIDDEN:
            ahead = math.degrees(math.atan2(*(drafting.centre(one)[k] - one.starts[0].position_ned[k] for k in (1, 0))))
            assert abs(math.remainder(one.starts[0].yaw_deg - ahead, 360.0)) == pytest.approx(90.0, abs=0.1), b


def test_a_path_is_long_enough_and_lies_on_the_ground_between_its_waypoints(drafting, draft):
    draft = drafting.cell(draft, "tracking")
    path = draft.record.target.path
    assert motion(draft.record.target).length_m > path.speed_mps * CAP_S
    draft = drafting.add_waypoint(draft, 60.0, 12.0)
    draft = drafting.move_waypoint(draft, 1, 40.0, -3.0)
    sound(drafting, draft)
    for a, b in itertools.pairwise(draft.record.target.path.waypoints_ned):
        for k in range(11):
            n, e, d = (p + (q - p) * k / 10 for p, q in zip(a, b, strict=True))
            assert d == pytest.approx(drafting.scene.terrain.at(n, e), abs=0.02)
    assert draft.knots[1] == (40.0, -3.0)
    assert drafting.shorten(draft).knots == draft.knots[:-1]
    assert len(draft.knots) < 12  # few enough to be dragged
    again = drafting.opened(draft.record)
    assert [tuple(round(v, 3) for v in knot) for knot in again.knots] == [
        tuple(round(v, 3) for v in knot) for knot in draft.knots
    ]


def test_a_path_moves_as_a_whole(drafting, draft):
    draft = drafting.add_waypoint(drafting.cell(draft, "tracking"), 60.0, 12.0)
    here = draft.knots[0]
    moved = drafting.move_target(draft, here[0] + 2.0, here[1] - 1.0)
    for a, b in zip(draft.knots, moved.knots, strict=True):
        assert (b[0] - a[0], b[1] - a[1]) == pytest.approx((2.0, -1.0))


def test_stand_off_sets_the_distance_and_face_turns_to_the_target(drafting, draft):
    for distance in (12.0, 16.0, 24.0):
        draft = drafting.face(drafting.stand_off(draft, distance), 0)
        assert draft.record.start_distance_m == pytest.approx(distance, abs=0.01)
        assert abs(math.remainder(draft.record.starts[0].yaw_deg - draft.record.bearing_deg, 360.0)) < 0.1


def test_grid_places_four_drones_in_a_square(drafting, draft):
    starts = drafting.grid(draft).record.starts
    gaps = sorted(math.dist(a.position_ned[:2], b.position_ned[:2]) for a, b in itertools.combinations(starts, 2))
    assert gaps == pytest.approx([GRID_SIDE_M] * 4 + [GRID_SIDE_M * math.sqrt(2)] * 2, abs=2e-3)
    assert starts[0] == draft.record.starts[0]


def test_look_alikes_differ_only_in_their_inscription(drafting, draft):
    draft = drafting.cell(drafting.choose(draft, "van", "green"), "commanding")
    everyone = (draft.record.target, *draft.record.candidates)
    assert len({one.inscription for one in everyone}) == len(everyone) == 4
    assert {(one.asset, one.paint) for one in everyone} == {("van", "green")}
    gaps = [math.dist(a.position_ned, b.position_ned) for a, b in itertools.combinations(everyone, 2)]
    assert NEAREST_PAIR_M[0] <= min(gaps) <= NEAREST_PAIR_M[1]
    assert WIDEST_PAIR_M[0] <= max(gaps) <= WIDEST_PAIR_M[1]
    draft = drafting.inscribe(drafting.choose(draft, "suv", "red"), 2, " ab 12 ")
    assert draft.record.candidates[1].inscription == "AB 12"
    assert {(one.asset, one.paint) for one in draft.record.candidates} == {("suv", "red")}
    assert draft.record.target.inscription in draft.record.instruction


def test_a_thing_of_the_map_can_be_the_target(drafting, draft):
    name = next(one.name for one in drafting.scene.instances if one.kind == "hydrant")
    draft = drafting.adopt(draft, name)
    assert (draft.record.target.native, draft.record.target.asset) == (name, "hydrant")
    assert World(draft.record).target.name == name  # it stands where the record says
    ahead = draft.record.starts[0].yaw_deg - draft.record.bearing_deg
    assert math.remainder(ahead, 360.0) == pytest.approx(0.0, abs=0.1)  # the drone faces it
    with pytest.raises(UsageError, match=name):
        drafting.move_target(draft, 0.0, 0.0)
    back = drafting.choose(draft, "suv", "cyan")
    assert back.record.target.native is None
    sound(drafting, back)
    with pytest.raises(UsageError, match="'road'"):
        drafting.adopt(draft, "road")
    with pytest.raises(UsageError, match="tracking"):
        drafting.adopt(drafting.cell(draft, "tracking"), name)


OPERATIONS = st.one_of(
    st.tuples(st.just("move_target"), st.floats(-60, 60), st.floats(-40, 40), st.floats(-999, 999)),
    st.tuples(st.just("move_start"), st.just(0), st.floats(-60, 60), st.floats(-40, 40), st.floats(-999, 999)),
    st.tuples(st.just("raise_start"), st.just(0), st.floats(0.3, 10)),
    st.tuples(st.just("add_waypoint"), st.floats(-60, 60), st.floats(-40, 40)),
    st.tuples(st.just("add_candidate"), st.floats(-60, 60), st.floats(-40, 40)),
    st.tuples(st.just("cell"), st.sampled_from(CELLS)),
    st.tuples(st.just("choose"), st.sampled_from(assets.names()), st.sampled_from(assets.PAINTS)),
    st.tuples(st.just("inscribe"), st.just(0), st.sampled_from(["", "AB 1", "x-9"])),
    st.tuples(st.sampled_from(["add_start", "drop_start", "grid", "shorten", "drop_candidate"])),
    st.tuples(st.just("face"), st.just(0), st.floats(-180, 180)),
    st.tuples(st.just("stand_off"), st.floats(5, 60)),
    st.tuples(st.just("set_speed"), st.floats(-1, 20)),
)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(OPERATIONS, max_size=8))
def test_any_operations_keep_the_record_valid_and_can_be_undone(drafting, tmp_path, work):
    def done(name, arguments, draft):
        return getattr(drafting, name)(draft, *arguments)

    first = drafting.new("residential")
    session = Session(drafting, first, tmp_path)
    for name, *arguments in work:
        before = session.draft
        try:
            session.do(partial(done, name, arguments))
        except UsageError:
            assert session.draft is before  # rejected as a whole
        if session.record.cell == "commanding" and not session.record.target.inscription:
            session.undo()  # an inscription was removed: `save` rejects that, and so would `sound`
        sound(drafting, session.draft)
    while session.undo():
        pass
    assert session.draft == first


# ---- the session


@pytest.fixture
def session(drafting, draft, tmp_path):
    return Session(drafting, draft, tmp_path / "records")


def test_a_drag_is_one_undo_step(session, drafting):
    for k in range(20):
        session.do(lambda d, k=k: drafting.move_target(d, 10.0 + k, 0.0), gesture="target")
    session.settle()
    session.do(lambda d: drafting.move_target(d, 0.0, 5.0), gesture="target")
    assert session.undo()
    assert session.record.target.position_ned[0] == 29.0
    assert session.undo()
    assert not session.undo()
    assert session.redo()
    assert session.record.target.position_ned[0] == 29.0


def test_a_new_step_clears_the_redo_history(session, drafting):
    session.do(lambda d: drafting.move_target(d, 1.0, 1.0))
    session.undo()
    session.do(lambda d: drafting.move_target(d, 2.0, 2.0))
    assert not session.redo()


def test_a_record_is_written_and_read_back(session, drafting):
    session.do(lambda d: drafting.rename(d, "my-first"))
    path = session.save()
    assert path.name == "my-first.json"
    assert catalogue.load(path) == session.record
    with pytest.raises(UsageError, match=r"my-first\.json"):
        session.save()
    session.do(lambda d: drafting.move_target(d, 3.0, 3.0))
    assert catalogue.load(session.save(replace=True)) == session.record
    assert [p.name for p in path.parent.iterdir()] == ["my-first.json"]


@pytest.mark.parametrize("replacing", [False, True])
def test_a_record_with_the_id_of_a_shipped_episode_is_rejected(session, drafting, replacing):
    session.do(lambda d: drafting.rename(d, catalogue.DEFAULT))
    with pytest.raises(UsageError, match=f"'{catalogue.DEFAULT}'"):
        session.save(replace=replacing)


def test_a_shipped_file_is_never_overwritten_silently(drafting, draft):
    kept = (catalogue.FOLDER / f"{catalogue.DEFAULT}.json").read_bytes()
    session = Session(drafting, replace(draft, record=replace(draft.record, id=catalogue.DEFAULT)), catalogue.FOLDER)
    with pytest.raises(UsageError, match=rf"{catalogue.DEFAULT}\.json"):
        session.save()
    assert (catalogue.FOLDER / f"{catalogue.DEFAULT}.json").read_bytes() == kept


def test_an_invalid_id_is_rejected_and_writes_no_file(session, drafting, tmp_path):
    for name in ("", "../evil", "/etc/passwd", "a/b", "A", "a\0b", "x" * 65, "..", "a.json"):
        session.do(lambda d, name=name: drafting.rename(d, name))
        with pytest.raises(UsageError, match="'id'"):
            session.save(replace=True)
        assert list(tmp_path.rglob("*.json")) == [], name


def test_things_on_a_stand_cannot_be_moving_targets(drafting):
    draft = drafting.cell(drafting.new("residential"), "tracking")
    with pytest.raises(UsageError, match=r"tracking .*quadrotor"):
        drafting.choose(draft, "quadrotor", "cyan")
    stood = drafting.choose(drafting.new("residential"), "quadrotor", "cyan")
    assert drafting.cell(stood, "tracking").record.target.asset == "suv"
