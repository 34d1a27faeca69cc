"""Whose fault it was decides what happens: wrong usage exits 2, broken infrastructure exits 3, a lost episode 0."""


class DronecatsError(Exception):
    """Base of every error this project raises on purpose. Its text is one sentence for a person."""

    exit_status = 3


class UsageError(DronecatsError):
    """The caller asked for something that cannot be: names what, where, and what to do instead."""

    exit_status = 2


class InfrastructureError(DronecatsError):
    """A part that the flight stands on broke (simulator, link, camera, model endpoint, logger).

    Never scored as a failed episode.
    """

    exit_status = 3


class LinkError(InfrastructureError):
    """The autopilot is silent, gone, or refused a command that the flight cannot do without."""


class ModelError(InfrastructureError):
    """The model endpoint cannot be reached or answers with something that is not a chat completion."""


class ModelRejectedError(ModelError):
    """The model endpoint rejects every question: a wrong key, no such model or path, no credit."""

    def __init__(self, said: str, status: int) -> None:
        super().__init__(said)
        self.status = status  # of HTTP

    def __reduce__(self) -> tuple[type, tuple[str, int]]:
        """Make it anew from both where it crosses to another process."""
        return type(self), (str(self), self.status)


class UnreadableError(ModelError):
    """So many replies in a row are no actions that the settings of the model are taken to be wrong."""


class CameraError(InfrastructureError):
    """The camera gives no frame."""


class BudgetError(InfrastructureError):
    """What the flight may cost is spent. Nobody's fault, and nobody's score."""
