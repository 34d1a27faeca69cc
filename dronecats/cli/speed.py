"""--speed, as several verbs have it."""


def speed(text: str) -> float | None:
    """Return the factor on real time that is asked for; None for `max`. Raises UsageError."""
    from foundation.errors import UsageError

    if text == "max":
        return None
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not 0.01 <= factor <= 100.0:
        raise UsageError(f"--speed wants max or a factor from 0.01 to 100, got '{text}'")
    return factor
