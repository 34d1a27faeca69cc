"""Tests reading place expressions from commands."""

import math

from hypothesis import assume, given
from hypothesis import strategies as st

from dronecats.pilots.vision import place_target, shape_detector
from dronecats.pilots.vision.command import KIND_OF_NOUN, PlaceExpression, read_place_expression
from episodes.authoring.check import referring
from episodes.authoring.propose import draft
from episodes.maps import campus_plan
from episodes.records import catalogue

CAMPUS = [i for i in catalogue.all_ids() if "campus" in i]
HALLS = ("Euler Hall", "Tesla Labs", "the library with the columns", "Gauss Building")
KINDS = st.sampled_from(sorted(KIND_OF_NOUN))


def test_campus_instructions_are_parsed_as_the_episode_check_parses_them():
    for episode in CAMPUS:
        record = catalogue.load(episode)
        phrases = [mark.phrase for mark in campus_plan.LANDMARKS] + [f"the {noun}" for noun in KIND_OF_NOUN]
        theirs, ours = referring.read(record.instruction, phrases), read_place_expression(record.instruction)
        assert ours is not None, episode
        assert theirs is not None, episode
        assert (ours.relation, len(ours.landmarks)) == (theirs.relation, len(theirs.landmarks)), episode
        assert ours.kind == KIND_OF_NOUN[theirs.noun], episode
        named = [KIND_OF_NOUN.get(phrase.removeprefix("the ")) for phrase in theirs.landmarks]
        assert list(ours.landmarks) == named, episode
        assert [kind is None for kind in named] == [
            any(p in HALLS or "Hall" in p for p in [mark]) for mark in theirs.landmarks
        ], episode


@given(
    st.sampled_from(
        [verb for cell in ("approaching", "searching", "tracking", "search-and-track") for verb in draft.VERBS[cell]]
    ),
    KINDS,
    st.sampled_from([r for r in referring.RELATIONS if r != "between"]),
    st.one_of(KINDS.map(lambda noun: f"the {noun}"), st.sampled_from(HALLS)),
    st.sampled_from(("it", "them")),
)
def test_any_thing_in_any_relation_is_read_from_any_sentence(verb, noun, relation, mark, pronoun):
    instruction = verb.format(what=f"the {noun} {relation} {mark}", it=pronoun)
    landmark_kind = KIND_OF_NOUN.get(mark.removeprefix("the "))
    sought = verb in draft.VERBS["searching"] or verb in draft.VERBS["search-and-track"]
    assert read_place_expression(instruction) == PlaceExpression(KIND_OF_NOUN[noun], relation, (landmark_kind,), sought)


@given(KINDS, KINDS, KINDS)
def test_between_has_two_landmarks(noun, first, second):
    read = read_place_expression(f"fly after the {noun} between the {first} and the {second} and reach them")
    assert read is not None
    assert read.landmarks == (KIND_OF_NOUN[first], KIND_OF_NOUN[second])
    assert read_place_expression(f"fly to the {noun} between the {first}") is None


@given(st.text(max_size=120))
def test_any_text_gives_a_place_expression_or_none(text):
    read = read_place_expression(text)
    assert read is None or read.kind in shape_detector.KINDS


def test_a_command_with_only_a_colour_has_no_place_expression():
    assert read_place_expression("go to the cyan SUV") is None
    assert read_place_expression("find the red hatchback and catch up with it") is None


SPOTS = st.tuples(st.floats(-30.0, 30.0), st.floats(4.0, 50.0))


@given(SPOTS, SPOTS)
def test_the_fit_of_a_relation_agrees_with_the_episode_check(spot, mark):
    here, stands = (0.0, 0.0), referring.Footprint(mark[1], mark[0], (0.5, 0.5), 0.0)
    for relation in ("left of", "right of", "in front of", "behind"):
        expression = referring.Expression("bench", relation, ("the mark",))
        clear, loose = referring.denotes(
            expression, {"it": (spot[1], spot[0], 0.0)}, {"the mark": stands}, (*here, 0.0)
        )
        fits = place_target.relation_fit(relation, spot, [mark])
        assert not clear or fits > 0.45, relation
        assert loose or fits < 0.75, relation


@given(SPOTS, SPOTS, SPOTS)
def test_only_one_of_two_is_the_nearest_unless_their_distances_are_similar(a, b, mark):
    fits = [place_target.relation_fit("nearest", x, [mark], [y]) for x, y in ((a, b), (b, a))]
    far = [math.dist(x, mark) for x in (a, b)]
    assert fits[far.index(min(far))] >= fits[far.index(max(far))]
    if max(far) > 1.6 * min(far) + 1.0:
        assert min(fits) == 0.0


@given(SPOTS, SPOTS, st.floats(0.3, 0.7))
def test_a_spot_on_the_line_between_two_landmarks_is_between_them(a, b, share):
    assume(math.dist(a, b) > 1.0)
    spot = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
    assert place_target.relation_fit("between", spot, [a, b]) > 0.99
    assert place_target.relation_fit("between", (2 * b[0] - a[0], 2 * b[1] - a[1]), [a, b]) < 0.01
