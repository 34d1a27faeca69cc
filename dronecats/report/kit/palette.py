"""The colours of all pages: the light and the dark theme, and the marks on pictures and maps."""

from collections.abc import Mapping, Sequence

LIGHT = {
    "paper": "#f6f6f3", "panel": "#ffffff", "ink": "#1b1d21", "quiet": "#5a606a", "mute": "#7b818b", "line": "#dcdcd6",
    "soft": "#ececE7", "shade": "#0004", "link": "#0b57a4", "accent": "#0b6bcb", "good": "#0b7a32", "bad": "#b3261e",
    "odd": "#7a5200", "judge": "#fdf3dc", "judge-line": "#d9b45b", "goal": "#c1169b",
    "d0": "#b36b00", "d1": "#0b6fc4", "d2": "#c2245c", "d3": "#7446d0", "d4": "#007d63", "d5": "#c04f00",
    "d6": "#4d5a00", "d7": "#7a4a7a", "side-a": "#0b6fc4", "side-b": "#c25700",
    "map-paper": "#e9ebe4", "map-line": "#ffffff",
    "blue": "#0072b2", "vermilion": "#d55e00", "green": "#00805f", "purple": "#b2588d", "orange": "#b97f00",
    "sky": "#2f8fc4",
}  # fmt: skip
DARK = {
    "paper": "#101216", "panel": "#181b21", "ink": "#e9eaec", "quiet": "#a2a9b4", "mute": "#8b929d", "line": "#343a44",
    "soft": "#22262e", "shade": "#000c", "link": "#7db8ff", "accent": "#59a5ff", "good": "#4fce7d", "bad": "#ff8279",
    "odd": "#e8b64c", "judge": "#2b2413", "judge-line": "#7d662b", "goal": "#ff5fdc",
    "d0": "#ffb000", "d1": "#5ab4ff", "d2": "#ff6f99", "d3": "#b99bff", "d4": "#1fd8ab", "d5": "#ff8f40",
    "d6": "#c3d04a", "d7": "#dba5db", "side-a": "#5ab4ff", "side-b": "#ff9a45",
    "map-paper": "#1c2026", "map-line": "#2d323b",
    "blue": "#4fb0ea", "vermilion": "#ff8a3d", "green": "#2fd0a0", "purple": "#e39bc4", "orange": "#f2b53a",
    "sky": "#8fd0f5",
}  # fmt: skip
MARKS = {  # on pictures, on maps and in the 3-D scene, in both themes
    "chosen": "#ffe600",  # the point of a go, in the picture and on the map
    "declared-good": "#3fe07a",
    "declared-bad": "#ff5a4f",
    "setpoint": "#12b886",
    "goal": "#ff46dc",  # the target, and the radius around it
    "path": "#f2b53a",  # path of a moving target
}
PRINTED = {"paper": "#ffffff", "ink": "#000000", "quiet": "#333333", "mute": "#666666", "line": "#bbbbbb",
           "soft": "#eeeeee", "link": "#000000"}  # fmt: skip

Rgb = tuple[int, int, int]  # sRGB, 0 … 255


def css() -> str:
    """Return the palette as CSS: the theme of the system or of `data-theme`, and a light theme for print."""
    return "".join((
        f":root {{ color-scheme: light; {_variables(MARKS | LIGHT)} }}\n",
        f'@media (prefers-color-scheme: dark) {{ :root:not([data-theme="light"]) {{ color-scheme: dark;'
        f" {_variables(DARK)} }} }}\n",
        f':root[data-theme="dark"] {{ color-scheme: dark; {_variables(DARK)} }}\n',
        f"@media print {{ :root, :root[data-theme] {{ color-scheme: light; {_variables(LIGHT | PRINTED)} }} }}\n",
    ))  # fmt: skip


def rgb(color: str) -> Rgb:
    """Return a colour (#rrggbb) as sRGB, 0 … 255."""
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return red, green, blue


def linear(color: str) -> tuple[float, float, float]:
    """Return a colour (#rrggbb) as linear RGB, 0 … 1, for glTF. Source: IEC 61966-2-1."""
    red, green, blue = (
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (part / 255.0 for part in rgb(color))
    )
    return red, green, blue


DRONES = tuple(DARK[f"d{number}"] for number in range(8))  # colours of drones and runs in 3-D scenes


def shade(color: Sequence[float]) -> Rgb:
    """Return a linear colour, 0 … 1, as sRGB, 0 … 255: the inverse of `linear`."""
    red, green, blue = (round(255 * (12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055)) for c in color)
    return red, green, blue


def _variables(colors: Mapping[str, str]) -> str:
    return " ".join(f"--{name}: {color};" for name, color in colors.items())
