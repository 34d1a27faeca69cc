import re

import pytest

from dronecats.agent.action import Finished, Go, Rotate, Think
from dronecats.agent.commanding.command_prompt import CAUSES, CommandPrompt
from dronecats.agent.prompt import FLEET, FRAMED, SINGLE, History, Prompt
from dronecats.pilots import actions
from foundation.camera import CameraModel
from foundation.errors import UsageError
from tests.agent.paper_words import paper_fingerprints, rows


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


def test_prompt_fills_its_fields_and_nothing_else():
    prompt = Prompt.load()
    text = prompt.render("go to the {history} van", "1. THINK", 17, "yx")
    assert "go to the {history} van" in text
    assert '"point":[y, x]' in text
    assert "17" in text
    assert "1. THINK" in text
    for action in ('{"action":"go"', '{"action":"rotate"', '{"action":"think"}', '{"action":"finished"}'):
        assert action in text


def test_the_prompt_explains_thinks_and_the_effect_of_depth_on_strides():
    """As in the paper's prompt: a think does not waste a step, and far targets need large depths."""
    _, think, finished = (
        part.partition("\n# ")[0] for part in re.split('"(?:think|finished)"', Prompt.load().template)
    )
    assert re.search(r"never\s+(lost|wasted)", think)
    assert "arrived" in finished
    (depth,) = re.findall(r"depth_m: (.*?)\n\n", Prompt.load().template, re.S)
    assert re.search(r"far .*large.*long strides.*close.*small.*short", " ".join(depth.split()).lower())


def test_the_digest_depends_on_the_template():
    assert len(Prompt.load().digest) == 64
    assert Prompt("{instruction}{history}").digest != Prompt.load().digest


def test_a_prompt_without_its_fields_is_rejected(tmp_path):
    path = tmp_path / "prompt.txt"
    path.write_text("fly to {instruction}")
    with pytest.raises(UsageError, match=r"\{history\}"):
        Prompt.load(path)
    with pytest.raises(UsageError, match=r"missing\.txt"):
        Prompt.load(tmp_path / "missing.txt")


def test_the_prompt_of_a_fleet_asks_for_an_array_and_has_no_unfilled_field():
    text = Prompt.load().render("find the blue car", "Drone 1:\n1. THINK", 5, drones=4)
    assert re.search(r"array\D*4", text)
    assert "{" not in text.split("# Answer")[0]


@pytest.mark.parametrize("drones", [1, 4])
def test_the_prompts_do_not_reveal_the_success_criteria(drones):
    """The prompt hides the radius, that one arrival ends a fleet's episode, and how a fleet should search."""
    prompts = [Prompt.load().render("go to the van", "(none)", 5, drones=drones), CommandPrompt.load().template]
    text = " ".join(" ".join(prompts).split()).lower()
    assert not re.search(r"\b(five|5|5\.0)\s*(m|met\w+)\b", text)
    forbidden = r"\b(radius|enough|divide|share|split|spread|pool\w*|one drone|any drone|verif\w+|score\w*)\b"
    assert not re.search(forbidden, text)


def test_the_prompts_share_no_six_consecutive_words_with_the_paper():
    of_commander = (CommandPrompt.load().template, *CAUSES.values())
    ours = rows("\n".join((Prompt.load().template, *SINGLE.values(), *FLEET.values(), *FRAMED, *of_commander)))
    assert len(paper_fingerprints()) > 800
    assert [words for key, words in ours.items() if key in paper_fingerprints()] == []


ONE_OBJECT = """Fly there: {instruction}
Say one of {"action":"go","point":{point_fmt},"depth_m":<m>}, {"action":"finished"}. One object only, please.
Lately ({history_len}):
{history}
That was all. Only the object!
"""


def test_a_template_for_one_drone_asks_a_fleet_for_an_array(tmp_path):
    path = tmp_path / "prompt.txt"
    path.write_text(ONE_OBJECT)
    prompt = Prompt.load(path)
    alone = prompt.render("find the {n} van", "1. THINK", 5, "yx")
    assert alone == ONE_OBJECT.replace("{instruction}", "find the {n} van").replace("{point_fmt}", "[y, x]").replace(
        "{history_len}", "5"
    ).replace("{history}", "1. THINK")
    histories = "Drone 1:\n1. THINK\nDrone 2:\n1. FINISHED\nDrone 3:\n1. ROTATE angle=9deg"
    fleet = prompt.render("find the {n} van", histories, 5, drones=3)
    before, _, after = fleet.partition("find the {n} van")
    assert "3" in before
    assert re.search(r"array\D*3", after.rstrip().splitlines()[-1])
    read_back = actions.read_prompt(fleet).history
    assert [[p.kind for p in past] for past in read_back] == [["think"], ["finished"], ["rotate"]]


@pytest.mark.parametrize("knowing", ["{answer}", "You fly {drones} drones; answer with an array."])
def test_a_template_with_fleet_fields_is_rendered_without_additions(tmp_path, knowing):
    path = tmp_path / "prompt.txt"
    path.write_text(knowing + "\n{instruction}\n{history}")
    text = Prompt.load(path).render("find it", "Drone 1:\n1. THINK", 5, drones=4)
    assert text.endswith("find it\nDrone 1:\n1. THINK")
    assert "4" in text


@pytest.mark.parametrize(
    ("field", "hint"), [("{instrution}", "{instruction}"), ("{point_format}", "{point_fmt}"), ("{wind}", "history_len")]
)
def test_an_unknown_field_is_rejected_with_a_hint(tmp_path, field, hint):
    path = tmp_path / "prompt.txt"
    path.write_text("{instruction} {history} " + field)
    with pytest.raises(UsageError, match=re.escape(field)) as refused:
        Prompt.load(path)
    assert hint in str(refused.value)
    path.write_text('{instruction} {history} {"action":"think"} { wind } {}')
    Prompt.load(path)
