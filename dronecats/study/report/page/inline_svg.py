"""A figure's SVG as a part of a page, its colours the page's own: one drawing that is right on dark and on light."""

import re

from dronecats.report.figures import style

# as the drawing has them → the page's variables
COLOURS = {
    style.INK: "ink", style.GREY: "mute", style.LIGHT: "line", "#000000": "ink", style.BLUE: "blue",
    style.VERMILION: "vermilion", style.GREEN: "green", style.PURPLE: "purple", style.ORANGE: "orange",
    style.SKY: "sky", "#FFFFFF": "panel",
}  # fmt: skip
HEAD = re.compile(r"^.*?(?=<svg\b)", re.DOTALL)
METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)
STYLE = re.compile(r"<style\b.*?</style>", re.DOTALL)
OPENING = re.compile(r"<svg\b[^>]*>")
VIEW = re.compile(r'viewBox="([^"]*)"')
ID = re.compile(r'\bid="([^"]+)"')
BACKGROUND = re.compile(r'<g id="patch_1">.*?</g>', re.DOTALL)
IN_FIELD = re.compile(r"<!-- \d+ -->")


def inline(svg: str, key: str, label: str) -> str:
    """Return the drawing as an element that a page can hold; `key` is put before its ids, `label` says what it shows.

    Text without a colour is black in SVG: it takes the page's ink. White and black that numbers have in coloured fields
    stay, as these fields do.
    """
    body = STYLE.sub("", METADATA.sub("", HEAD.sub("", svg)))
    body = BACKGROUND.sub("", body, count=1)
    box = VIEW.search(body)
    size = box[1] if box else "0 0 100 100"
    body = OPENING.sub("", body, count=1)
    body = ID.sub(lambda found: f'id="{key}-{found[1]}"', body)
    body = body.replace('="#', f'="#{key}-').replace("url(#", f"url(#{key}-")
    for colour, name in COLOURS.items():
        body = re.sub(rf"{colour}(?![0-9a-fA-F])", f"var(--{name})", body, flags=re.IGNORECASE)
    return f'<svg role="img" aria-label="{label}" viewBox="{size}" xmlns:xlink="http://www.w3.org/1999/xlink">{body}'
