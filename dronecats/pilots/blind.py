"""A pilot that does not look: the floor of the benchmark.

It walks a fixed pattern, the same for every picture, and never declares, so by the paper's criterion it can never
succeed. It shows what arrives by chance and keeps the whole chain busy without a model.
"""

from dronecats.pilots import briefing, reply

_STRIDE_M = 6.0  # a `go` of 5 m or more is flown as a full 3 m step
_TURN_DEG = 60.0


def answer(prompt: str, images: list[bytes]) -> str:
    """Return the next action of the pattern think, go, rotate, go, rotate …; it depends on the last action alone."""
    told = briefing.read(prompt)
    return reply.fleet([_next(told.past(k)) for k in range(max(1, len(images)))])


def _next(past: tuple[briefing.PastAction, ...]) -> str:
    if not past:
        return reply.think()
    if past[-1].kind == "go":
        return reply.rotate(_TURN_DEG)
    return reply.go(500, 500, _STRIDE_M)
