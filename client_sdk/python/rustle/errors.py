"""What can go wrong, each with a field and a remedy where there is one."""
from __future__ import annotations


class RustleError(Exception):
    """Why something did not succeed.

    code       v1.ErrorCode's number where the daemon refused (such as 7); 0 where it happened on this side
    code_name  such as "unknown_topology", "unreachable", "timeout", "invalid"
    field      such as "frame.positions"; may be empty
    message    a sentence
    remedy     a sentence; may be empty
    """

    def __init__(self, code_name: str, message: str, remedy: str = "", field: str = "", code: int = 0) -> None:
        super().__init__(code_name, message, remedy, field, code)
        self.code = code
        self.code_name = code_name
        self.field = field
        self.message = message
        self.remedy = remedy

    def __str__(self) -> str:
        where = f" in {self.field}" if self.field else ""
        return f"{self.code_name}{where}: {self.message}" + (f" {self.remedy}" if self.remedy else "")


class InvalidArgument(RustleError, ValueError):
    """An argument that cannot be sent; nothing was sent."""

    def __init__(self, field: str, message: str, remedy: str) -> None:
        super().__init__("invalid", message, remedy, field)

    def __reduce__(self) -> tuple[type[InvalidArgument], tuple[str, str, str]]:
        return InvalidArgument, (self.field, self.message, self.remedy)


class Unreachable(RustleError, ConnectionError):
    """Nobody answers at the endpoint, or the daemon is gone."""


class TimedOut(RustleError, TimeoutError):
    """The daemon is there, but what was waited for did not come in time."""


class Refused(RustleError):
    """The daemon said no."""


class SessionLost(Refused):
    """The daemon no longer has the session: it was started anew, or ended the session because nothing came."""


class Closed(RustleError):
    """The session was detached, or the connection closed, on this side."""
