"""Text from outside is made safe to display on a terminal."""

import json
import re
import unicodedata

from hypothesis import given
from hypothesis import strategies as st

from foundation.wording import printable

ANY = st.text(st.characters() | st.characters(categories=["Cc", "Cf", "Cs", "Zl", "Zp"]))


@given(ANY)
def test_the_result_contains_no_control_characters(text):
    shown = printable(text)
    assert all(each == "\n" or each.isprintable() or unicodedata.category(each) == "Zs" for each in shown)
    assert printable(shown) == shown


@given(ANY.filter(lambda text: "\\" not in text))
def test_the_original_text_can_be_restored(text):
    read = re.sub(r"(?:\\u[0-9a-f]{4})+", lambda spelt: str(json.loads(f'"{spelt[0]}"')), printable(text))
    assert read.encode("utf-16", "surrogatepass") == text.encode("utf-16", "surrogatepass")


@given(st.recursive(ANY, lambda inner: st.lists(inner) | st.dictionaries(ANY, inner), max_leaves=4))
def test_json_keeps_its_meaning(value):
    text = json.dumps(value, ensure_ascii=False, indent=1)
    assert json.dumps(json.loads(printable(text))) == json.dumps(json.loads(text))


def test_ordinary_text_is_shown_unchanged():
    text = "Où\u00a0? 左の車\u3000へ, 5°, naïve — “so”\nand מימין"
    assert printable(text) == text


def test_terminal_control_characters_are_escaped():
    text = "\x1b]52;c;Zm9v\x07 \x9b2J\r\x08\x00 \u202egnp.exe\u2066 \ud800 \U000e0041\u2028\ttab\x7f"
    shown = r"\u001b]52;c;Zm9v\u0007 \u009b2J\u000d\u0008\u0000 \u202egnp.exe\u2066 \ud800 \udb40\udc41\u2028"
    assert printable(text) == shown + r"\u0009tab\u007f"
