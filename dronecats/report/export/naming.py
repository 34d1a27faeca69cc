"""What is called how in every format, so that nobody takes what the judge knows for what the drone knew."""

JUDGE = "judge"  # what stands under it was unknown to agent and autopilot: true places, targets, verdicts


def drone_name(number: int) -> str:
    """Return what a drone is called."""
    return f"drone_{number}"
