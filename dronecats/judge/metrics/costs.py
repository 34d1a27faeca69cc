"""How often the model was asked, how long it took and how much it read and wrote. Paper, "Variance and Throughput
Sensitivity".

What a reply for several drones cost is counted once, at the first of them.
"""

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.metric import Metric, MetricValue, known_values, median, of_questions, quantile


def control_rate(flight: JudgedFlight) -> list[MetricValue]:
    """Return per question the decisions per second (Hz) since the last one; None for the first."""
    return of_questions(flight.steps, lambda decision: decision.rate_hz)


def latency(flight: JudgedFlight) -> list[MetricValue]:
    """Return per question the vehicle time (s) that the reply took."""
    return of_questions(flight.steps, lambda decision: decision.latency_s)


def tokens_in(flight: JudgedFlight) -> list[MetricValue]:
    """Return per question the tokens that the model read, as the server counts them."""
    return of_questions(flight.steps, lambda decision: decision.tokens_in)


def tokens_out(flight: JudgedFlight) -> list[MetricValue]:
    """Return per question the tokens that the model wrote, as the server counts them."""
    return of_questions(flight.steps, lambda decision: decision.tokens_out)


def questions(flight: JudgedFlight) -> int:
    """Return how many replies became decisions within the cap."""
    return sum(step.counts and step.asks for step in flight.steps)


def median_latency(flight: JudgedFlight) -> float | None:
    """Return the median of `latency`, s."""
    return median(latency(flight))


def slow_rate(flight: JudgedFlight) -> float | None:
    """Return the 5 % quantile of `control_rate`, Hz."""
    return quantile(control_rate(flight), 0.05)


def median_rate(flight: JudgedFlight) -> float | None:
    """Return the median of `control_rate`, Hz."""
    return median(control_rate(flight))


def fast_rate(flight: JudgedFlight) -> float | None:
    """Return the 95 % quantile of `control_rate`, Hz."""
    return quantile(control_rate(flight), 0.95)


def all_tokens_in(flight: JudgedFlight) -> float | None:
    """Return the sum of `tokens_in`; None where no server counted."""
    told = known_values(tokens_in(flight))
    return sum(told) if told else None


def all_tokens_out(flight: JudgedFlight) -> float | None:
    """Return the sum of `tokens_out`; None where no server counted."""
    told = known_values(tokens_out(flight))
    return sum(told) if told else None


THROUGHPUT = "Variance and Throughput Sensitivity"
METRICS = (
    Metric(
        name="rate_hz", title="Control rate", unit="Hz", level="step", better=None,
        definition="1 / vehicle time since the decision before; none for the first",
        paper=THROUGHPUT, of=control_rate,
    ),
    Metric(
        name="latency_s", title="Latency", unit="s", level="step", better="less",
        definition="vehicle time that the reply took",
        paper=THROUGHPUT, of=latency,
    ),
    Metric(
        name="tokens_in", title="Tokens in", unit="count", level="step", better="less",
        definition="tokens that the model read, as the server counts them",
        paper="Serving and Decoding", of=tokens_in,
    ),
    Metric(
        name="tokens_out", title="Tokens out", unit="count", level="step", better="less",
        definition="tokens that the model wrote, as the server counts them",
        paper="Serving and Decoding", of=tokens_out,
    ),
    Metric(
        name="questions", title="Steps", unit="count", level="episode", better=None,
        definition="replies that became decisions within the cap; one for all drones that it was for",
        paper="Commanding Several Drones", of=questions,
    ),
    Metric(
        name="median_latency_s", title="Latency (median)", unit="s", level="episode", better="less",
        definition="median of latency_s over the questions",
        paper=THROUGHPUT, of=median_latency,
    ),
    Metric(
        name="rate_hz_5", title="Control rate (5 %)", unit="Hz", level="episode", better=None,
        definition="5 % quantile of rate_hz over the questions",
        paper=THROUGHPUT, of=slow_rate,
    ),
    Metric(
        name="rate_hz_50", title="Control rate (median)", unit="Hz", level="episode", better=None,
        definition="median of rate_hz over the questions",
        paper=THROUGHPUT, of=median_rate,
    ),
    Metric(
        name="rate_hz_95", title="Control rate (95 %)", unit="Hz", level="episode", better=None,
        definition="95 % quantile of rate_hz over the questions",
        paper=THROUGHPUT, of=fast_rate,
    ),
    Metric(
        name="all_tokens_in", title="Tokens in (all)", unit="count", level="episode", better="less",
        definition="sum of tokens_in over the questions",
        paper="Serving and Decoding", of=all_tokens_in,
    ),
    Metric(
        name="all_tokens_out", title="Tokens out (all)", unit="count", level="episode", better="less",
        definition="sum of tokens_out over the questions",
        paper="Serving and Decoding", of=all_tokens_out,
    ),
)  # fmt: skip
