"""What a command says is written, and when what was read is that."""

from dronecats.pilots.vision.inscription import SURE, Inscription, ReadText, agrees, named, place
from episodes.records import catalogue


def test_every_commanding_instruction_names_its_inscription():
    for name in [one for one in catalogue.ids() if "commanding" in one]:
        record = catalogue.load(name)
        found = named(record.instruction)
        assert found is not None, name
        assert record.target.inscription is not None, name
        assert found.text == record.target.inscription.replace(" ", ""), name
        assert found.on_plate == (record.map == "residential"), name


def test_no_other_instruction_does():
    for name in [one for one in catalogue.ids() if "commanding" not in one]:
        assert named(catalogue.load(name).instruction) is None, name


def test_a_place_in_words():
    for command, which in (
        ("look at the second one from the left", 1),
        ("fly to the sign that reads WEST: the third sign from the right", -3),
        ("the leftmost", 0),
        ("go to the rightmost van", -1),
        ("fly to the van on the left of the house", None),
        ("find the sign marked GATE 8 and go to it", None),
    ):
        assert place(command) == which, command


def test_a_text_is_believed_when_it_is_sure_and_whole():
    for wanted, read, confidence, known in (
        (Inscription("GATE8", False), "GATE 8", SURE, True),
        (Inscription("GATE8", False), "GATE8", SURE - 0.01, None),
        (Inscription("GATE8", False), "GATE 9", SURE, False),
        (Inscription("GATE8", False), "GATE 9", SURE - 0.01, None),
        (Inscription("4329", True), "4329", SURE, True),
        (Inscription("4329", True), "4339", SURE, False),
        (Inscription("4329", True), "432", SURE, None),  # cut off: not another one
        (Inscription("4329", True), "B329", SURE, None),  # no plate has letters
        (Inscription("WEST", False), "", SURE, None),
    ):
        assert agrees(wanted, [ReadText(read, confidence)]) is known, (wanted, read)
