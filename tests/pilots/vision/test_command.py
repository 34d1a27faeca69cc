"""What a thing is told by, out of the words."""

import math

from hypothesis import assume, given
from hypothesis import strategies as st

from dronecats.pilots.vision import place_target, shape_detector
from dronecats.pilots.vision.command import KIND_OF_NOUN, NamedLandmark, PlaceExpression, read_place_expression
from episodes.authoring.check import referring
from episodes.authoring.propose import draft
from episodes.maps import campus
from episodes.records import catalogue

CAMPUS = [i for i in catalogue.all_ids() if "campus" in i]
HALLS = ("Euler Hall", "Tesla Labs", "the library with the columns", "Gauss Building")
KINDS = st.sampled_from(sorted(KIND_OF_NOUN))


def test_every_instruction_of_the_campus_is_read_as_the_catalogue_reads_it():
    for episode in CAMPUS:
        record = catalogue.load(episode)
        known = [mark.phrase for mark in campus.landmarks()] + [f"the {noun}" for noun in KIND_OF_NOUN]
        theirs, ours = referring.read(record.instruction, known), read_place_expression(record.instruction)
        assert ours is not None, episode
        assert theirs is not None, episode
        assert (ours.relation, len(ours.landmarks)) == (theirs.relation, len(theirs.landmarks)), episode
        assert ours.kind == KIND_OF_NOUN[theirs.noun], episode
        assert [one.words for one in ours.landmarks] == [p.removeprefix("the ") for p in theirs.landmarks], episode
        assert [one.kind is None for one in ours.landmarks] == [
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
def test_any_thing_in_any_relation_is_read_out_of_any_sentence(verb, noun, how, mark, pronoun):
    said = verb.format(what=f"the {noun} {how} {mark}", it=pronoun)
    known = KIND_OF_NOUN.get(mark.removeprefix("the "))
    sought = verb in draft.VERBS["searching"] or verb in draft.VERBS["search-and-track"]
    assert read_place_expression(said) == PlaceExpression(
        KIND_OF_NOUN[noun], how, (NamedLandmark(mark.removeprefix("the "), known),), sought
    )


@given(KINDS, KINDS, KINDS)
def test_between_has_two_landmarks(noun, one, other):
    read = read_place_expression(f"fly after the {noun} between the {one} and the {other} and reach them")
    assert read is not None
    assert [mark.words for mark in read.landmarks] == [one, other]
    assert read_place_expression(f"fly to the {noun} between the {one}") is None


@given(st.text(max_size=120))
def test_any_words_are_read_or_are_not(text):
    read = read_place_expression(text)
    assert read is None or read.kind in shape_detector.KINDS


def test_a_colour_alone_is_no_place():
    assert read_place_expression("go to the cyan SUV") is None
    assert read_place_expression("find the red hatchback and catch up with it") is None


SPOTS = st.tuples(st.floats(-30.0, 30.0), st.floats(4.0, 50.0))


@given(SPOTS, SPOTS)
def test_what_the_catalogue_calls_beside_fits_and_what_it_would_never_call_so_does_not(spot, mark):
    here, stands = (0.0, 0.0), referring.Footprint(mark[1], mark[0], (0.5, 0.5), 0.0)
    for how in referring.SEEN_FROM:
        told = referring.Expression("bench", how, ("the mark",))
        clear, loose = referring.denotes(told, {"it": (spot[1], spot[0], 0.0)}, {"the mark": stands}, (*here, 0.0))
        fits = place_target.relation_fit(how, spot, [mark])
        assert not clear or fits > 0.45, how
        assert loose or fits < 0.75, how


@given(SPOTS, SPOTS, SPOTS)
def test_only_one_of_two_is_the_nearest_unless_they_are_alike(a, b, mark):
    fits = [place_target.relation_fit("nearest", x, [mark], [y]) for x, y in ((a, b), (b, a))]
    far = [math.dist(x, mark) for x in (a, b)]
    assert fits[far.index(min(far))] >= fits[far.index(max(far))]
    if max(far) > 1.6 * min(far) + 1.0:
        assert min(fits) == 0.0


@given(SPOTS, SPOTS, st.floats(0.3, 0.7))
def test_what_lies_on_the_way_from_one_to_the_other_is_between(a, b, share):
    assume(math.dist(a, b) > 1.0)
    spot = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
    assert place_target.relation_fit("between", spot, [a, b]) > 0.99
    assert place_target.relation_fit("between", (2 * b[0] - a[0], 2 * b[1] - a[1]), [a, b]) < 0.01
