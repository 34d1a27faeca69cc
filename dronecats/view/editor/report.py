"""The findings about a draft as the browser shows them. Everything that a person wrote is escaped."""

from collections.abc import Sequence
from html import escape

from dronecats.report.kit.palette import LIGHT
from episodes.authoring.check.finding import RuleFinding

GREEN, RED, GREY = (LIGHT[name] for name in ("good", "bad", "mute"))


def checks_html(findings: Sequence[RuleFinding], fresh: bool) -> str:
    """Return the list of checks, red ones first; a stale one, of the draft before the last change, is dimmed."""
    failed = [f for f in findings if not f.passed]
    title = f"{len(findings) - len(failed)} of {len(findings)} checks passed" if findings else "Checking …"
    color = GREY if not findings else RED if failed else GREEN
    rows = "".join(_row(f) for f in (*failed, *(f for f in findings if f.passed)))
    return (
        f'<div id="checks" data-failed="{len(failed)}" data-fresh="{str(fresh).lower()}" '
        f'style="font-size:12px;line-height:1.35;padding:2px 10px 8px;opacity:{1.0 if fresh else 0.55}">'
        f'<div style="font-size:14px;font-weight:600;color:{color};margin:4px 0 6px">{title}</div>{rows}</div>'
    )


def _row(found: RuleFinding) -> str:
    color, mark = (GREEN, "✓") if found.passed else (RED, "✗")
    wanted = f'<div style="opacity:0.65">wanted {escape(found.wanted)}</div>' if not found.passed else ""
    measured = f"<b>{escape(found.measured)}</b>{wanted}"
    return (
        f'<div title="wanted: {escape(found.wanted)}" '
        'style="display:flex;gap:7px;padding:2px 0;border-top:1px solid rgba(128,128,128,0.18)">'
        f'<span style="color:{color};font-weight:700">{mark}</span>'
        f'<span style="flex:1">{escape(_capital(_short(found.rule)))}</span>'
        f'<span style="text-align:right;max-width:50%;color:{color}">{measured}</span></div>'
    )


def _short(rule: str) -> str:
    """Return a rule without its article: in a list nobody misses it."""
    return rule.removeprefix("the ")


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def facts_html(rows: Sequence[tuple[str, str]]) -> str:
    """Return pairs of a name and a value as one line each."""
    lines = "".join(
        f'<div style="display:flex;justify-content:space-between"><span style="opacity:0.65">{escape(name)}</span>'
        f"<b>{escape(value)}</b></div>"
        for name, value in rows
    )
    return f'<div style="font-size:12px;line-height:1.6;padding:2px 10px 6px">{lines}</div>'
