"""The metrics that tables and figures go by, as `dronecats.judge.metrics.registry` names them."""

from dataclasses import dataclass

SUCCESS = "success"
ORACLE_SUCCESS = "oracle_success"
DECLARED = "declared"
NE = "ne_m"
APPROACH = "approach_ratio"
DECLARED_TO_START = "declared_to_start"
FIRST = "success_at_first"
WITHIN_THREE = "success_within_three"
PRECISION = "declaration_precision"
FALSE = "false_declarations"
DECLARATIONS = "declarations"
DECISIONS = "decisions"
UNREADABLE = "unreadable"
REFUSED = "refused"
CUT_OFF = "cut_off"
RATE = "rate_hz"  # of steps, and all below
LATENCY = "latency_s"
ON_TARGET = "on_target"
POINTING = "pointing_error_deg"
DEPTH = "depth_error_m"
DEPTH_ABSOLUTE = "depth_error_abs_m"
RESCALED = "rescaled"
WIDE = "wide_rotation"


@dataclass(frozen=True, slots=True)
class EndedAs:
    """One way in which a flight, or a drone of a fleet, ends."""

    name: str  # as the collection has it
    title: str  # as tables and figures have it

    @property
    def column(self) -> str:
        """The column that holds its share (%)."""
        return f"{self.name.replace(' ', '_')}_percent"


MODES = (  # as `failure_mode` names them, in the order of the paper's bars; who did not move stands apart, at the end
    EndedAs("success", "Success"),
    EndedAs("declared", "Declared, never true"),
    EndedAs("arrived", "Arrived, undeclared"),
    EndedAs("never grounded", "Never grounded"),
    EndedAs("oscillated", "Oscillated"),
    EndedAs("never closed", "Never closed"),
    EndedAs("timed out", "Timed out"),
    EndedAs("did not move", "Did not move"),
)
DRONES = (  # metrics, each a count of an episode's drones
    EndedAs("drones_found", "Found the target"),
    EndedAs("drones_beside", "Declared at a look-alike"),
    EndedAs("drones_elsewhere", "Declared elsewhere"),
    EndedAs("drones_silent", "Never declared"),
)
