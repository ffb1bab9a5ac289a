"""What can go wrong between us and the API server.

`ApiError` is an answer with an error; `Unreachable` is no (complete) answer. Both carry `maybe_applied`: whether a write
may have taken effect all the same. Nobody retries a write on our behalf: the caller reads first, then decides.
"""

import re
from collections.abc import Mapping
from typing import Any, Final

import msgspec


class ClientError(Exception):
    """Base of everything this package raises on purpose."""

    maybe_applied: bool = False


class Unreachable(ClientError):
    """No complete answer: refused, reset, truncated or timed out. `maybe_applied` is False only if nothing was sent."""

    def __init__(self, message: str, *, maybe_applied: bool) -> None:
        super().__init__(message)
        self.maybe_applied = maybe_applied


class TooLong(ClientError):
    """An answer to a read is longer than the caller takes into memory; it was not read to its end."""


class Silent(Unreachable):
    """An answer had begun, and nothing more of it was heard for as long as we listen."""


class LoginError(ClientError):
    """No usable credentials; the text names the file or plug-in and the cure."""


MOST_PAUSE_S: Final = 30.0
"""A longer Retry-After is not followed: an overloaded server is tried again, and a day of blindness helps it as little."""


class ApiError(ClientError):
    """An answer with status >= 400.

    `reason` is the machine word of the Status object ("AlreadyExists"), `causes` its (field, reason, message) triples,
    `retry_after_s` the server's wish from the Retry-After header or the Status details, None when it has none.
    """

    def __init__(
        self,
        message: str,
        *,
        status: int,
        reason: str = "",
        causes: tuple[tuple[str, str, str], ...] = (),
        retry_after_s: float | None = None,
    ) -> None:
        super().__init__(message)
        self.status = status
        self.reason = reason
        self.message = message
        self.causes = causes
        self.retry_after_s = retry_after_s

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.status} {self.reason}: {self.message})"

    @property
    def pause_s(self) -> float:
        """The shortest pause before the next try: the server's wish, at most `MOST_PAUSE_S`; 0 without one."""
        return min(self.retry_after_s or 0.0, MOST_PAUSE_S)


class BadRequest(ApiError):
    """400: the request itself is malformed."""


class Unauthorized(ApiError):
    """401: credentials missing, wrong or expired (refreshed and tried once more before this is raised)."""


class Forbidden(ApiError):
    """403: known to the server, not allowed; quota and admission refusals come here too."""


class NamespaceTerminating(Forbidden):
    """403: the object's namespace is being deleted, so nothing can be created there any more. That passes only with the namespace."""


class NotFound(ApiError):
    """404."""


class Conflict(ApiError):
    """409: resourceVersion, uid or field-ownership conflict."""


class AlreadyExists(ApiError):
    """409 with reason AlreadyExists: a create found the name taken. Not a Conflict: the cure is another one."""


class Gone(ApiError):
    """410: the resourceVersion or continue token is older than the server's history."""


class Invalid(ApiError):
    """422: schema, CEL or validation refused the object; `causes` name the fields."""


class TooManyRequests(ApiError):
    """429: not executed; also an eviction that a disruption budget forbids for now."""


class ServerError(ApiError):
    """5xx: the server or its etcd is in trouble; a write may have been applied (a 504 often was)."""

    maybe_applied = True


def means_gone(error: ApiError, name: str) -> bool:
    """Whether the API server itself answers that this very object does not exist.

    A 404 of a proxy, or of a resource the server does not serve at the moment, is an error like any other.
    """
    return error.status == 404 and error.reason == "NotFound" and f'"{name}" not found' in error.message


def means_another(error: ApiError) -> bool:
    """Whether an object of another uid has the name by now, as the answer to a write with the uid it is meant for shows.

    A delete and a binding conflict; a patch is answered with "the uid cannot be changed". The status of our own kinds
    is written whatever uid the patch names: only a resourceVersion keeps it from another object.
    """
    if isinstance(error, Conflict):
        return _OTHER_UID.search(error.message) is not None
    return isinstance(error, Invalid) and any(field == "metadata.uid" for field, _, _ in error.causes)


def may_pass(error: ClientError) -> bool:
    """Whether the same write may succeed later: no answer, too much at once, a server in trouble, another client's write.

    Ask `means_another` first: a conflict about the uid never passes.
    """
    return not isinstance(error, ApiError) or error.status >= 500 or error.status in (409, 429)


_OTHER_UID: Final = re.compile("uid in (the )?precondition", re.IGNORECASE)
"""Every conflict names its object, and a name may contain `uid`, too."""
NAMESPACE_TERMINATING: Final = "NamespaceTerminating"
"""Reason of the cause that the API server adds to such a refusal."""
_BY_STATUS: dict[int, type[ApiError]] = {
    400: BadRequest,
    401: Unauthorized,
    403: Forbidden,
    404: NotFound,
    409: Conflict,
    410: Gone,
    422: Invalid,
    429: TooManyRequests,
}


class _Cause(msgspec.Struct):
    field: str = ""
    reason: str = ""
    message: str = ""


class _Details(msgspec.Struct):
    causes: list[_Cause] | None = None
    retryAfterSeconds: float = 0  # noqa: N815 - the wire name; a rename table would be longer


class Status(msgspec.Struct):
    """meta/v1 Status as far as we read it: the body of errors and the object of ERROR watch events."""

    message: str = ""
    reason: str = ""
    code: int = 0
    details: _Details | None = None


_STATUS = msgspec.json.Decoder(Status)


def parse_retry_after(header: str | None) -> float | None:
    """Seconds of a Retry-After header; None for absence and for the HTTP-date form, which Kubernetes never sends."""
    if header is None:
        return None
    try:
        seconds = float(header)
    except ValueError:
        return None
    return seconds if 0 <= seconds < float("inf") else None


def error_from_status(status: Status, *, code: int = 0, retry_after_s: float | None = None) -> ApiError:
    """Turn a Status object into its exception; `code` is the HTTP status when there was one."""
    code = code or status.code or 500
    details = status.details or _Details()
    if retry_after_s is None and details.retryAfterSeconds > 0:
        retry_after_s = details.retryAfterSeconds
    kind = _BY_STATUS.get(code, ServerError if code >= 500 else ApiError)
    if code == 409 and status.reason == "AlreadyExists":
        kind = AlreadyExists
    if code == 403 and any(cause.reason == NAMESPACE_TERMINATING for cause in details.causes or ()):
        kind = NamespaceTerminating
    if code == 500 and status.reason == "Expired":
        kind = Gone
    return kind(
        status.message or status.reason or f"HTTP {code}",
        status=code,
        reason=status.reason,
        causes=tuple((cause.field, cause.reason, cause.message) for cause in details.causes or ()),
        retry_after_s=retry_after_s,
    )


def error_from_response(code: int, headers: Mapping[str, str], body: bytes) -> ApiError:
    """The exception for an HTTP answer >= 400, whatever its body (proxies in between answer in plain text or HTML)."""
    try:
        status = _STATUS.decode(body)
    except (msgspec.DecodeError, UnicodeDecodeError):
        status = Status(message=body[:400].decode("utf-8", "replace").strip())
    return error_from_status(status, code=code, retry_after_s=parse_retry_after(headers.get("Retry-After")))


def describe(error: BaseException) -> dict[str, Any]:
    """Log fields of an error, the same words everywhere."""
    fields: dict[str, Any] = {"error": type(error).__name__, "message": str(error)}
    if isinstance(error, ApiError):
        fields |= {"status": error.status, "reason": error.reason}
    if isinstance(error, ClientError):
        fields["maybe_applied"] = error.maybe_applied
    return fields
