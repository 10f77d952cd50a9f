"""Exceptions. Each failed call of the C API becomes one, with its status and the words of oc_last_error."""

from __future__ import annotations

from ._enums import Status


class Error(Exception):
    """A call or a job has failed."""

    status: Status
    """The reason."""
    need: int
    """The least memory budget in bytes that suffices, if `status` is OVER_BUDGET. Otherwise 0."""

    def __init__(self, message: str, status: Status, need: int = 0) -> None:
        super().__init__(message)
        self.status = status
        self.need = need

    def __reduce__(self) -> tuple[type[Error], tuple[str, Status, int]]:
        return type(self), (str(self), self.status, self.need)


class ArgumentError(Error, ValueError):
    """An argument is out of its range, or belongs to another context. Nothing changed."""


class StateError(Error):
    """The present state of the object does not allow the call. Nothing changed."""


class Cancelled(Error):
    """The work was cancelled on request."""


class InputError(Error):
    """An input file cannot be parsed, or a model file is damaged."""


class VersionError(Error):
    """Library, package or model file have different versions."""


class LimitError(Error):
    """The memory budget is too small (`need` is the least that suffices), or a build exceeds a limit."""


class MachineError(Error):
    """Reading or writing failed, or the system refused memory or a thread."""


class InternalError(Error):
    """A defect of the library."""


_BY_STATUS: dict[int, type[Error]] = {
    Status.INVALID_ARGUMENT: ArgumentError, Status.CANCELLED: Cancelled,
}
_BY_HUNDRED: dict[int, type[Error]] = {
    1: StateError, 2: InputError, 3: VersionError, 4: LimitError, 5: MachineError, 6: InternalError,
}


def error(status: int, message: str, need: int = 0) -> Error:
    """Returns the exception of a status."""
    kind = _BY_STATUS.get(status) or _BY_HUNDRED.get(status // 100, Error)
    try:
        return kind(message, Status(status), need)
    except ValueError:
        return InternalError(f"{message} (unknown status {status})", Status.INTERNAL)
