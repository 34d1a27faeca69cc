"""Errors and their exit statuses: 2 for wrong usage, 3 for broken infrastructure. A failed episode exits with 0."""


class DronecatsError(Exception):
    """Base class of the project's errors. The text is one sentence for the user."""

    exit_status = 3


class UsageError(DronecatsError):
    """The user asked for something impossible. The text names the fault, its place, and what to do instead."""

    exit_status = 2


class InfrastructureError(DronecatsError):
    """The simulator, link, camera, model endpoint or logger failed. The flight is not scored."""

    exit_status = 3


class LinkError(InfrastructureError):
    """The autopilot does not answer, or has rejected a necessary command."""


class ModelError(InfrastructureError):
    """The model endpoint cannot be reached or answers with something that is not a chat completion."""

    lost: tuple[int, int] = (0, 0)  # tokens (in, out) of answers without a usable reply, which the vendor counts too


class ModelRejectedError(ModelError):
    """The model endpoint rejects every question, for example because of a wrong key or model name, or no credit."""

    def __init__(self, message: str, status: int) -> None:
        super().__init__(message)
        self.status = status  # HTTP status

    def __reduce__(self) -> tuple[type, tuple[str, int]]:
        """Pickle both arguments."""
        return type(self), (str(self), self.status)


class UnreadableError(ModelError):
    """Too many replies in a row without an action: the settings of the model must be wrong."""


class CameraError(InfrastructureError):
    """The camera gives no frame."""


class BudgetError(InfrastructureError):
    """The limit on the cost or the tokens of a run's models is reached. The flight is not scored."""
