"""Tests how the pilots read the command and the histories from the prompt."""

from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.action import Finished, Go, Rotate, Think
from dronecats.agent.prompt import NONE_YET, History, Prompt, labels
from dronecats.pilots import actions
from dronecats.pilots import scripted as blind
from dronecats.pilots.vision.command import SIZES, read_referent
from foundation.camera import CameraModel


def prompt(history, command="go to the cyan SUV"):
    return Prompt.load().render(command, history, 5)


def test_command_and_history_are_parsed_as_the_agent_writes_them():
    history = History(CameraModel())
    for action in (Go(500, 600, 9.5), Rotate(-45), Think(), Finished()):
        history.append(action)
    parsed = actions.read_prompt(prompt(history.render()))
    assert parsed.command == "go to the cyan SUV"
    assert [p.kind for p in parsed.past(0)] == ["go", "rotate", "think", "finished"]
    assert parsed.past(0)[0].depth_m == 9.5
    assert parsed.past(0)[1].angle_deg == -45


def test_the_first_step_has_no_history():
    assert actions.read_prompt(prompt(NONE_YET)).past(0) == ()


def test_each_drones_history_follows_the_line_with_its_number():
    text = "Command: x\nDrone 1:\n1. THINK\n2. FINISHED\nDrone 2:\n(none yet)\nDrone 3:\n1. ROTATE angle=60deg"
    parsed = actions.read_prompt(text)
    assert [[p.kind for p in parsed.past(k)] for k in range(4)] == [["think", "finished"], [], ["rotate"], []]


def test_the_labels_of_pictures_do_not_change_the_histories():
    """The server joins all texts of a message, so a fleet's picture labels come after its prompt."""
    histories = [
        f"Drone {k}:\n1. {past}  <- latest" for k, past in enumerate(("THINK", "FINISHED", "ROTATE angle=9deg"), 1)
    ]
    text = Prompt.load().render("go to the cyan SUV", "\n".join(histories), 5, drones=3)
    labelled = actions.read_prompt("\n".join((text, *labels(3))))
    assert labelled == actions.read_prompt(text)
    assert [[p.kind for p in labelled.past(k)] for k in range(4)] == [["think"], ["finished"], ["rotate"], []]


@given(st.text(max_size=300))
def test_no_text_breaks_the_reader(text):
    read_referent(actions.read_prompt(text).command)


def test_colour_and_noun_are_read_from_a_command():
    for command, color, noun in (
        ("go to the cyan SUV", "cyan", "suv"),
        ("Fly to the red pickup truck next to the white house", "red", "pickup truck"),
        ("find the house with the green car in front", "green", "car"),
        ("go to the person in the orange jacket", "orange", "person"),
        ("Find the blue car with license plate 4017", "blue", "car"),
        ("go to the school bus", None, "school bus"),
        ("the turquoise thing", "cyan", "car"),
        ("", None, "car"),
    ):
        named = read_referent(command)
        assert (named.color, named.size) == (color, SIZES[noun]), command


def test_blind_never_declares_and_answers_once_per_picture():
    history = History(CameraModel())
    from dronecats.agent.reply.strict import parse, parse_fleet

    for _ in range(12):
        action = parse(blind.answer(prompt(history.render()), [b""]))
        assert not isinstance(action, Finished)
        history.append(action)
    assert len(parse_fleet(blind.answer("", [b""] * 3), 3)) == 3
