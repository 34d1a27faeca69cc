"""All that a study's report tells, computed once: the tables, the figures and the page are written from it."""

from dataclasses import dataclass

from dronecats.study.analysis.effects import HeatMap, MainEffect, heat_maps, main_effects
from dronecats.study.analysis.halves import HalfAlong, halves
from dronecats.study.analysis.levels import AtLevel, at_levels
from dronecats.study.analysis.paired_flights import PairedDifference, between_entrants, between_levels
from dronecats.study.analysis.points import AtPoint, at_points, over_points
from dronecats.study.analysis.steps import MotionAt, ServedAt, motions, served
from dronecats.study.analysis.studied import Studied, StudiedFactor


@dataclass(frozen=True, slots=True)
class FactorFindings:
    """What was found along one factor."""

    number: int  # of the factor
    factor: StudiedFactor
    levels: tuple[AtLevel, ...]
    halves: tuple[HalfAlong, ...]
    between_levels: tuple[PairedDifference, ...]
    between_entrants: tuple[PairedDifference, ...]
    served: tuple[ServedAt, ...]
    motions: tuple[MotionAt, ...]

    def named(self, name: str) -> str:
        """Return the name of a table or figure of this factor."""
        return f"{name}_{self.factor.name}"


@dataclass(frozen=True, slots=True)
class Findings:
    """What was found in a study."""

    studied: Studied
    command: str  # that makes the report again
    factors: tuple[FactorFindings, ...]
    effects: tuple[MainEffect, ...]
    maps: tuple[HeatMap, ...]
    points: tuple[AtPoint, ...]  # those who fly beside one another at each point
    over_points: tuple[PairedDifference, ...]  # and over all of them alike


def findings(studied: Studied, command: str) -> Findings:
    """Return what is found in a study; `command` is the command line of the report."""
    points = at_points(studied)
    return Findings(
        studied=studied,
        command=command,
        factors=tuple(_along(studied, number) for number in range(len(studied.factors))),
        effects=tuple(main_effects(studied)),
        maps=tuple(heat_maps(studied)),
        points=tuple(points),
        over_points=tuple(over_points(studied, points)),
    )


def _along(studied: Studied, number: int) -> FactorFindings:
    return FactorFindings(
        number=number,
        factor=studied.factors[number],
        levels=tuple(at_levels(studied, number)),
        halves=tuple(halves(studied, number)),
        between_levels=tuple(between_levels(studied, number)),
        between_entrants=tuple(between_entrants(studied, number)),
        served=tuple(served(studied, number)),
        motions=tuple(motions(studied, number)),
    )
