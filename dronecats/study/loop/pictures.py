"""The study of the loops in pictures: margins, steps, the onset of oscillation, the stream, the trace."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dronecats.report.figures import style
from dronecats.study.loop.margins import LoopStudy
from dronecats.study.loop.results import LoopResults
from dronecats.study.loop.stream import WORSE, Tolerance
from dronecats.study.loop.trace import AXES, FlownTrace

COLOURS = (style.BLUE, style.VERMILION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY)
MARKERS = ("o", "s", "^", "D", "v", "P")
GROUP_COLOURS = {"rate": style.BLUE, "attitude": style.ORANGE, "velocity": style.GREEN}
AGREED = 0.2  # of the injected margin, within which a prediction has to be
POINTS = 300  # of a curve that oscillates
SHOWN = ("roll rate", "roll attitude", "horizontal velocity", "vertical velocity")


def draw(found: LoopResults, out: Path, command: str) -> dict[str, Path]:
    """Draw what there is as SVG, PDF and PNG, the command in each; return the PNGs by name.

    Raises InfrastructureError.
    """
    made = {}
    with style.styled():
        if found.studies:
            made["margins"] = margins(found.studies)
            made["steps"] = steps(found.studies)
            made["onset"] = onset(found.studies)
        if found.tolerances:
            made["stream"] = stream(found.tolerances)
        if found.traces:
            made["trace"] = trace(found.traces, found.traced)
        for each in made.values():
            each.supxlabel(command, fontsize=6.0, color=style.GREY)
        return {name: style.save(each, out, name) for name, each in made.items()}


def _panels(rows: int, columns: int, height_in: float, **options: Any) -> tuple[Any, Any]:
    made = style.canvas(height_in)
    return made, made.subplots(rows, columns, squeeze=False, **options)


def _airframes(studies: Sequence[LoopStudy] | Sequence[Tolerance]) -> list[str]:
    return list(dict.fromkeys(each.airframe for each in studies))


def margins(studies: Sequence[LoopStudy]) -> Any:
    """Return the injected delay margins over the predicted ones, the band of AGREED around equality."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

    made, axes = _panels(1, 1, 3.6)
    axis = axes[0, 0]
    values = 1e3 * np.array([(each.predicted.delay_s, each.injected.delay_s) for each in studies])
    line = np.array([0.7 * values.min(), 1.4 * values.max()])
    axis.fill_between(line, line / (1.0 + AGREED), line / (1.0 - AGREED), color=style.LIGHT, linewidth=0.0)
    axis.plot(line, line, color=style.GREY, linewidth=0.8)
    names = _airframes(studies)
    for each in studies:
        axis.plot(
            1e3 * each.predicted.delay_s, 1e3 * each.injected.delay_s, linestyle="none", markersize=5.0,
            marker=MARKERS[names.index(each.airframe) % len(MARKERS)], color=GROUP_COLOURS[each.loop.group],
            markerfacecolor="none",
        )  # fmt: skip
    for group in dict.fromkeys(each.loop.group for each in studies):
        axis.plot([], [], linestyle="none", marker="o", color=GROUP_COLOURS[group], label=f"{group} loops")
    for k, name in enumerate(names):
        axis.plot([], [], linestyle="none", marker=MARKERS[k % len(MARKERS)], color=style.INK, label=name,
                  markerfacecolor="none")  # fmt: skip
    axis.fill_between([], [], [], color=style.LIGHT, label=f"within {AGREED:.0%}")
    axis.set(
        xscale="log", yscale="log", xlim=line, ylim=line,
        xlabel="delay margin that python-control predicts (ms)", ylabel="injected delay that oscillates (ms)",
    )  # fmt: skip
    ticks = [each for each in (10, 20, 50, 100, 200, 500, 1000) if line[0] <= each <= line[1]]
    for scale in (axis.xaxis, axis.yaxis):
        scale.set_major_locator(FixedLocator(ticks))
        scale.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        scale.set_minor_formatter(NullFormatter())
    axis.legend(loc="upper left")
    return made


def steps(studies: Sequence[LoopStudy]) -> Any:
    """Return what each airframe does with a small step of some loops, nothing late."""
    shown = [name for name in SHOWN if any(each.loop.name == name for each in studies)] or [studies[0].loop.name]
    made, axes = _panels(1, len(shown), 2.0, sharey=True)
    names = _airframes(studies)
    for axis, name in zip(axes[0], shown, strict=True):
        for each in studies:
            if each.loop.name == name:
                answer, k = each.answers[0.0], names.index(each.airframe)
                axis.plot(answer.time, answer.value / answer.step, color=COLOURS[k % len(COLOURS)], linewidth=0.9,
                          label=each.airframe)  # fmt: skip
        axis.axhline(1.0, color=style.GREY, linewidth=0.6)
        axis.set(title=name, xlabel="s")
    axes[0, 0].set_ylabel("share of the step")
    axes[0, -1].legend(loc="lower right")
    return made


def onset(studies: Sequence[LoopStudy]) -> Any:
    """Return how the first airframe's loops fade, stay and grow below, at and above their injected margins."""
    first = [each for each in studies if each.airframe == studies[0].airframe]
    shown = [each for each in first if each.loop.name in SHOWN] or first[:1]
    made, axes = _panels(3, len(shown), 4.0, sharex="col", sharey=True)
    for column, each in zip(axes.T, shown, strict=True):
        late = [delay_s for delay_s in each.answers if delay_s > 0.0]
        for axis, delay_s, colour in zip(column, late, (style.GREEN, style.INK, style.VERMILION), strict=True):
            answer = each.answers[delay_s]
            thin = max(len(answer.time) // POINTS, 1)
            axis.plot(answer.time[::thin], answer.value[::thin] / answer.step, color=colour, linewidth=0.7)
            axis.set_title(f"{1e3 * delay_s:.0f} ms, {delay_s / each.injected.delay_s:.1f} ×", fontsize=7.0)
            axis.set_ylim(-3.0, 5.0)
        column[0].set_title(f"{each.loop.name}\n{column[0].get_title()}", fontsize=7.0)
        column[-1].set_xlabel("s")
    made.supylabel(f"share of the step, {studies[0].airframe}", fontsize=8.0)
    return made


def stream(tolerances: Sequence[Tolerance]) -> Any:
    """Return the tracking error over jitter and loss of the setpoint stream, and where offboard is left."""
    kinds = list(dict.fromkeys(each.impairment for each in tolerances))
    made, axes = _panels(1, len(kinds), 2.4, sharey=True)
    names = _airframes(tolerances)
    labels = {"jitter": "jitter of the setpoints (s)", "loss": "share of setpoints lost"}
    for axis, kind in zip(axes[0], kinds, strict=True):
        for each in tolerances:
            if each.impairment != kind:
                continue
            k = names.index(each.airframe)
            ratio = np.array(each.errors) / each.perfect
            stays = [all(trial.left_s is None for trial in trials) for trials in each.trials]
            colour = COLOURS[k % len(COLOURS)]
            axis.plot(np.array(each.levels)[stays], ratio[stays], marker=MARKERS[k % len(MARKERS)], markersize=3.0,
                      linewidth=0.9, color=colour, label=each.airframe)  # fmt: skip
            if each.left is not None:
                axis.axvline(each.left, color=colour, linewidth=1.2, linestyle=(2 * k, (2, 2 * len(names) - 2)))
        axis.axhline(WORSE, color=style.GREY, linewidth=0.6)
        axis.set_xlabel(labels.get(kind, kind))
    axes[0, 0].set_ylabel("tracking error, × a perfect wire")
    axes[0, 0].legend(loc="upper left")
    return made


def trace(traces: Sequence[FlownTrace], airframe: str) -> Any:
    """Return one setpoint trace and what each autopilot made of it."""
    made, axes = _panels(len(AXES), 1, 4.0, sharex=True)
    for k, (axis, name) in enumerate(zip(axes[:, 0], AXES, strict=True)):
        axis.plot(traces[0].time, traces[0].asked[:, k], color=style.GREY, linewidth=0.8, label="asked for")
        for each, colour in zip(traces, COLOURS, strict=False):
            label = {"ours": "our autopilot", "px4": "PX4"}[each.autopilot]
            axis.plot(each.time, each.flown[:, k], color=colour, linewidth=0.9, label=label)
        axis.set_ylabel(f"{name} ({'rad/s' if name == 'yaw rate' else 'm/s'})")
    axes[0, 0].set_title(airframe)
    axes[0, 0].legend(loc="upper right")
    axes[-1, 0].set_xlabel("s")
    return made
