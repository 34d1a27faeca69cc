"""The picture of a path comparison: both paths from above, their heights, and the distance between them."""

from pathlib import Path

from dronecats.report.path_comparison import PathComparison
from foundation.errors import UsageError


def draw(
    comparisons: tuple[PathComparison, ...], names: tuple[str, str], within_m: float, file: Path, axes: str
) -> None:
    """Write the picture; `axes` says what the plane's axes are. Raises UsageError when it cannot be written."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 6.5), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2)
    plan, height, apart = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])
    for comparison in comparisons:
        for path, name, style, colour in zip(
            (comparison.a, comparison.b), names, ("-", "--"), ("tab:blue", "tab:orange"), strict=True
        ):
            label = name if comparison.drone == comparisons[0].drone else None
            plan.plot(path.position[:, 1], path.position[:, 0], style, color=colour, label=label)
        for here, there in zip(comparison.here[::100], comparison.there[::100], strict=True):  # every ten seconds
            plan.plot([here[1], there[1]], [here[0], there[0]], "-", color="0.4", linewidth=1)
        height.plot(comparison.t, -comparison.here[:, 2], "-", color="tab:blue")
        height.plot(comparison.t, -comparison.there[:, 2], "--", color="tab:orange")
        apart.plot(comparison.t, comparison.distance_m, color="tab:red")
    apart.axhline(within_m, color="0.5", linewidth=1)
    plan.plot(0, 0, "k^")
    plan.set_aspect("equal", adjustable="datalim")
    ahead, right = axes.split(",")
    plan.set(xlabel=f"{right} [m]", ylabel=f"{ahead} [m]", title="from above, each from its own start")
    height.set(ylabel="height over the start [m]")
    apart.set(xlabel="time compared [s]", ylabel="apart [m]")
    plan.legend()
    for axis in (plan, height, apart):
        axis.grid(alpha=0.3)
    try:
        figure.savefig(file, dpi=110)
    except (OSError, ValueError) as error:
        raise UsageError(f"the picture {file} cannot be written: {error}") from None
