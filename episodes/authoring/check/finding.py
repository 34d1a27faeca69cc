"""What a rule has to say about a record."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RuleFinding:
    """One rule, applied."""

    rule: str  # what is demanded, a few words
    passed: bool
    measured: str  # with its unit
    wanted: str
    field: str = ""  # of the record, that would have to change

    @property
    def sentence(self) -> str:
        """Return the finding in one line, as a reason for a rejection."""
        about = f"field '{self.field}': " if self.field else ""
        return f"{about}{self.rule} is {self.measured}, wanted {self.wanted}"


def between(rule: str, value: float, limits: tuple[float, float], unit: str, digits: int = 2) -> RuleFinding:
    """Return whether a value lies within limits, both included."""
    low, high = limits
    return RuleFinding(rule, low <= value <= high, f"{value:.{digits}f} {unit}", f"{low:g} … {high:g} {unit}")


def at_least(rule: str, value: float, least: float, unit: str, digits: int = 2) -> RuleFinding:
    """Return whether a value reaches a limit."""
    return RuleFinding(rule, value >= least, f"{value:.{digits}f} {unit}", f"≥ {least:g} {unit}")


def at_most(rule: str, value: float, most: float, unit: str, digits: int = 2) -> RuleFinding:
    """Return whether a value stays within a limit."""
    return RuleFinding(rule, value <= most, f"{value:.{digits}f} {unit}", f"≤ {most:g} {unit}")
