import pytest

from dronecats.agent.action import Finished, Go, Rotate, Think
from dronecats.agent.history import History
from dronecats.agent.prompt import Prompt
from dronecats.border.camera import CameraModel
from dronecats.border.errors import UsageError


def test_history_is_five_lines_in_pixels_with_the_newest_tagged():
    history = History(CameraModel())
    assert history.render() == "(none yet — this is the first step)"
    for action in (Think(), Go(478.125, 597.2222, 9), Rotate(45), Think(), Finished(), Go(500, 500, 2.25)):
        history.append(action)
    assert history.render().splitlines() == [
        "1. GO x=612 y=430 depth=9m",
        "2. ROTATE angle=45deg",
        "3. THINK",
        "4. FINISHED",
        "5. GO x=640 y=360 depth=2.25m  <- latest",
    ]
    assert history.last == Go(500, 500, 2.25)


def test_prompt_fills_its_fields_and_nothing_else():
    prompt = Prompt.load()
    text = prompt.render("go to the {history} van", "1. THINK", 5, "yx")
    assert "Command: go to the {history} van" in text
    assert '"point":[y, x]' in text
    assert "last 5 actions" in text
    assert "1. THINK" in text
    for action in ('{"action":"go"', '{"action":"rotate"', '{"action":"think"}', '{"action":"finished"}'):
        assert action in text


def test_digest_is_of_the_template():
    assert len(Prompt.load().digest) == 64
    assert Prompt("{instruction}{history}").digest != Prompt.load().digest


def test_a_prompt_without_its_fields_is_refused(tmp_path):
    path = tmp_path / "prompt.txt"
    path.write_text("fly to {instruction}")
    with pytest.raises(UsageError, match=r"lacks the field .history"):
        Prompt.load(path)
    with pytest.raises(UsageError, match="cannot be read"):
        Prompt.load(tmp_path / "missing.txt")


def test_a_fleet_is_asked_for_an_array_and_told_about_its_pictures():
    text = Prompt.load().render("find the blue car", "Drone 1:\n1. THINK", 5, drones=4)
    assert "JSON array of 4 objects" in text
    assert "4 multirotors" in text
    assert "{" not in text.split("# Answer")[0]
    assert "One JSON object" not in text
