"""Synthetic studies in memory, without a folder."""

from collections.abc import Callable, Sequence

import numpy as np

from dronecats.study.analysis.study_results import StudiedFactor, StudiedFlight, StudiedLevel, StudyResults
from tests.support.scores import a_run, an_episode

Law = Callable[..., float]  # levels, in the order of the factors → log odds of success in the median episode


def a_study(
    factors: Sequence[StudiedFactor],
    points: Sequence[tuple[StudiedLevel, ...]],
    law: Law,
    *,
    episodes: int = 20,
    flights: int = 2,
    scatter: float = 1.0,
    entrants: Sequence[str] = ("vision",),
    seed: int = 0,
    design: str = "full factorial",
) -> StudyResults:
    """Return a study in which every episode is flown at every point. Success is drawn by the law."""
    rng = np.random.default_rng(seed)
    made = []
    for entrant in entrants:
        run = a_run(f"runs/{entrant}", pilot=entrant)
        for k, own in enumerate(rng.normal(0.0, scatter, episodes)):
            for number in range(1, flights + 1):
                for point in points:
                    won = rng.random() < 1 / (1 + np.exp(-law(*point) - own))
                    values = {"ne_m": 3.0 if won else 9.0, "dwell_s": 4.0, "longest_loss_s": 2.0}
                    scored = an_episode(run, f"campus-tracking-{k:02}", "success" if won else "failure", values=values)
                    made.append(StudiedFlight(entrant=entrant, levels=point, number=number, scored=scored))
    return StudyResults(
        name="made-up", design=design, factors=tuple(factors), entrants=tuple(entrants),
        cells=("tracking",), flights=tuple(made), planned=len(made),
    )  # fmt: skip


def number_factor(name: str, *levels: float, unit: str = "s") -> StudiedFactor:
    """Return a factor whose levels are numbers."""
    return StudiedFactor(name=name, unit=unit, levels=levels, reference=levels[0])
