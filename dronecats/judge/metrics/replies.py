"""Metrics of the replies: rates, latencies, tokens, and replies without an action.

Source: paper, "Variance and Throughput Sensitivity". A reply for several drones counts once, for the first of them.
"""

from collections.abc import Callable

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.metric import Metric, MetricFunction, MetricValue, median, quantile
from foundation.run_folder.rows import Decision

REFUSALS = ("refusal", "filtered")  # values of `Decision.finish`
CUT_OFF = ("length",)


def is_unreadable(decision: Decision) -> bool:
    """Return whether the reply has no valid action for the decision's drone."""
    return decision.action is None


def is_refused(decision: Decision) -> bool:
    """Return whether there is no action because the model refused, or its provider withheld the reply."""
    return is_unreadable(decision) and decision.finish in REFUSALS


def is_cut_off(decision: Decision) -> bool:
    """Return whether there is no action, and the reply ended at its length limit."""
    return is_unreadable(decision) and decision.finish in CUT_OFF


def question_values(flight: JudgedFlight, field: str) -> list[MetricValue]:
    """Return the value of a field for each decision; None after the cap (time limit), and for an unknown value.

    For a reply for several drones, only the first drone's decision has the value; the others have None.
    """
    return [getattr(step.decision, field) if step.counts and step.is_question else None for step in flight.steps]


def _per_question(field: str) -> MetricFunction:
    return lambda flight: question_values(flight, field)


def _token_sum(field: str) -> MetricFunction:
    """Return a function that adds up tokens. It returns None if no server counted them."""

    def of(flight: JudgedFlight) -> MetricValue:
        counts = [value for value in question_values(flight, field) if value is not None]
        return sum(counts) if counts else None

    return of


def _decision_count(counts: Callable[[Decision], bool]) -> MetricFunction:
    return lambda flight: sum(step.counts and counts(step.decision) for step in flight.steps)


THROUGHPUT = "Variance and Throughput Sensitivity"
METRICS = (
    Metric(
        name="rate_hz", title="Control rate", unit="Hz", level="step", better=None,
        definition="1 / vehicle time since the previous decision; null for the first",
        paper=THROUGHPUT, of=_per_question("rate_hz"),
    ),
    Metric(
        name="latency_s", title="Latency", unit="s", level="step", better="less",
        definition="vehicle time that the reply took",
        paper=THROUGHPUT, of=_per_question("latency_s"),
    ),
    Metric(
        name="tokens_in", title="Tokens in", unit="count", level="step", better="less",
        definition="tokens of the request, as the server counts them",
        paper="Serving and Decoding", of=_per_question("tokens_in"),
    ),
    Metric(
        name="tokens_out", title="Tokens out", unit="count", level="step", better="less",
        definition="tokens of the reply, as the server counts them",
        paper="Serving and Decoding", of=_per_question("tokens_out"),
    ),
    Metric(
        name="questions", title="Steps", unit="count", level="episode", better=None,
        definition="number of replies within the cap, one for each step; a reply for several drones counts once",
        paper="Commanding Several Drones",
        of=lambda flight: sum(step.counts and step.is_question for step in flight.steps),
    ),
    Metric(
        name="median_latency_s", title="Latency (median)", unit="s", level="episode", better="less",
        definition="median of latency_s over the replies",
        paper=THROUGHPUT, of=lambda flight: median(question_values(flight, "latency_s")),
    ),
    Metric(
        name="rate_hz_5", title="Control rate (5 %)", unit="Hz", level="episode", better=None,
        definition="5 % quantile of rate_hz over the replies",
        paper=THROUGHPUT, of=lambda flight: quantile(question_values(flight, "rate_hz"), 0.05),
    ),
    Metric(
        name="rate_hz_50", title="Control rate (median)", unit="Hz", level="episode", better=None,
        definition="median of rate_hz over the replies",
        paper=THROUGHPUT, of=lambda flight: median(question_values(flight, "rate_hz")),
    ),
    Metric(
        name="rate_hz_95", title="Control rate (95 %)", unit="Hz", level="episode", better=None,
        definition="95 % quantile of rate_hz over the replies",
        paper=THROUGHPUT, of=lambda flight: quantile(question_values(flight, "rate_hz"), 0.95),
    ),
    Metric(
        name="all_tokens_in", title="Tokens in (all)", unit="count", level="episode", better="less",
        definition="sum of tokens_in over the replies",
        paper="Serving and Decoding", of=_token_sum("tokens_in"),
    ),
    Metric(
        name="all_tokens_out", title="Tokens out (all)", unit="count", level="episode", better="less",
        definition="sum of tokens_out over the replies",
        paper="Serving and Decoding", of=_token_sum("tokens_out"),
    ),
    Metric(
        name="decisions", title="Decisions", unit="count", level="episode", better=None,
        definition="number of decisions within the cap; each drone counts",
        paper="", of=_decision_count(lambda decision: True),
    ),
    Metric(
        name="unreadable", title="Unreadable", unit="count", level="episode", better="less",
        definition="number of decisions whose reply has no valid action",
        paper="", of=_decision_count(is_unreadable),
    ),
    Metric(
        name="refused", title="Refused", unit="count", level="episode", better="less",
        definition="number of unreadable replies that the model refused or a filter of the provider withheld",
        paper="", of=_decision_count(is_refused),
    ),
    Metric(
        name="cut_off", title="Cut off", unit="count", level="episode", better="less",
        definition="number of unreadable replies that ended at the token limit",
        paper="", of=_decision_count(is_cut_off),
    ),
)  # fmt: skip
