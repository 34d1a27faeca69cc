"""Tests reading the inscription from a command, and its match with recognized text."""

from dronecats.pilots.vision.command import Inscription, read_inscription, read_place_in_row
from dronecats.pilots.vision.ocr import SURE_CONFIDENCE, ReadText, matches
from episodes.records import catalogue


def test_every_commanding_instruction_names_its_inscription():
    for name in [episode for episode in catalogue.ids() if "commanding" in episode]:
        record = catalogue.load(name)
        inscription = read_inscription(record.instruction)
        assert inscription is not None, name
        assert record.target.inscription is not None, name
        assert inscription.text == record.target.inscription.replace(" ", ""), name
        assert inscription.on_plate == (record.map == "residential"), name


def test_no_other_instruction_names_an_inscription():
    for name in [episode for episode in catalogue.ids() if "commanding" not in episode]:
        assert read_inscription(catalogue.load(name).instruction) is None, name


def test_a_place_in_a_row_is_read_from_words():
    for command, place in (
        ("look at the second one from the left", 1),
        ("fly to the sign that reads WEST: the third sign from the right", -3),
        ("the leftmost", 0),
        ("go to the rightmost van", -1),
        ("fly to the van on the left of the house", None),
        ("find the sign marked GATE 8 and go to it", None),
    ):
        assert read_place_in_row(command) == place, command


def test_a_text_matches_only_if_it_is_confident_and_complete():
    for wanted, read, confidence, is_match in (
        (Inscription("GATE8", False), "GATE 8", SURE_CONFIDENCE, True),
        (Inscription("GATE8", False), "GATE8", SURE_CONFIDENCE - 0.01, None),
        (Inscription("GATE8", False), "GATE 9", SURE_CONFIDENCE, False),
        (Inscription("GATE8", False), "GATE 9", SURE_CONFIDENCE - 0.01, None),
        (Inscription("4329", True), "4329", SURE_CONFIDENCE, True),
        (Inscription("4329", True), "4339", SURE_CONFIDENCE, False),
        (Inscription("4329", True), "432", SURE_CONFIDENCE, None),  # cut off: may be the same plate
        (Inscription("4329", True), "B329", SURE_CONFIDENCE, None),  # no plate has letters
        (Inscription("WEST", False), "", SURE_CONFIDENCE, None),
    ):
        assert matches(wanted, [ReadText(read, confidence)]) is is_match, (wanted, read)
