"""The causes of a missing reply, in the words of who knows them: the server, or the operating
system."""

import json
import os
import socket
import ssl
from collections.abc import Iterator
from typing import Any
from urllib.parse import urljoin, urlsplit

from pydantic_ai.exceptions import (
    ModelAPIError,
    ModelConnectionError,
    ModelHTTPError,
    ModelQuotaExceededError,
    ModelRateLimitError,
    ModelRequestRejectedError,
    ModelServerError,
    ModelTimeoutError,
    ModelUnavailableError,
)

from pliant.reasoners.vlm.words import one_line

_SOON = (408, 409, 425)  # refusals of the moment, whatever the request is
_SAY = ("message", "error", "detail", "msg", "errors")  # where servers put their words

NO_KEY = "no key was sent"
_MOST_TOLD = 300  # characters of a server's words, so that the advice has room
_DO = {
    401: "see that the key is this server's",
    403: "see what the key may do",
    404: "see that --model and the address are right",
    413: "send less with --no-goal-picture or fewer --history",
    429: "wait, or send fewer at once",
    529: "the provider has too much to do: try later",
}
"""What to do about a status."""

MAY_PASS = (
    ModelRateLimitError,
    ModelUnavailableError,
    ModelServerError,
    ModelConnectionError,
)
"""Errors that the same request may not meet again."""


def why(error: BaseException, base_url: str | None = None) -> str:
    """The cause of an error in one line: a server's status and its own message, or what the
    operating system says of the connection to `base_url`."""
    if isinstance(error, ModelHTTPError) and not 300 <= error.status_code < 400:
        meant = error.suggested_model_id
        told = one_line(said(error.body))[:_MOST_TOLD] or "no reason given"
        more = list(getattr(error, "__notes__", ()))
        more += [f"did you mean {meant}?"] if meant else _advice(error)
        told = told.rstrip(".") if more else told
        return one_line("; ".join([f"{error.status_code}: {told}", *more]))
    if isinstance(error, ModelConnectionError):
        place = f" to {address(base_url)}" if base_url else ""
        return one_line(f"connection{place} failed: {_systems(error)}")
    if (target := _sent_on_to(error)) is not None:
        place = f"{address(base_url)} sends" if base_url else "the server sends"
        return one_line(
            f"{place} what it is asked on to {target}: it is not followed, since the pictures and"
            " the key would go there; if that is the server, give its address"
        )
    return one_line(str(error)) or type(error).__name__


def _advice(error: ModelHTTPError) -> list[str]:
    """Advice that goes beyond the server's words; empty: none."""
    if error.retry_after is not None or NO_KEY in str(error.body):
        return []
    if isinstance(error, ModelQuotaExceededError):
        return ["waiting does not help: see the account's billing and limits"]
    return [_DO[error.status_code]] if error.status_code in _DO else []


def causes(error: BaseException | None) -> Iterator[BaseException]:
    """An error and its causes, the nearest first."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        if isinstance(error, BaseExceptionGroup):
            for one in error.exceptions:
                yield from causes(one)
        error = error.__cause__ or error.__context__


def will_not_pass(error: BaseException) -> bool:
    """Whether the same request, sent again in a while, would meet the same end: it was refused for
    what it is or whose it is, or nobody is there to hear it or to answer in time."""
    if isinstance(error, ModelTimeoutError) or _sent_on_to(error) is not None:
        return True
    if isinstance(error, ModelConnectionError):
        return _is_nobody(error)
    if isinstance(error, ModelHTTPError) and not isinstance(error, MAY_PASS):
        return 400 <= error.status_code < 500 and error.status_code not in _SOON
    return isinstance(error, ModelRequestRejectedError | ModelQuotaExceededError)


def said(body: Any) -> str:
    """A server's own words in the body of its error, whatever shape it has; empty: none."""
    if isinstance(body, dict):
        found = (said(body[name]) for name in _SAY if name in body)
        return next(filter(None, found), "") or (json.dumps(body, default=str) if body else "")
    if isinstance(body, list):
        return "; ".join(filter(None, map(said, body)))
    if isinstance(body, str) and body.lstrip().startswith(("{", "[")):
        try:
            return said(json.loads(body)) or body
        except ValueError:
            return body
    return "" if body is None else str(body)


def refusal(status: int, body: Any, model: str) -> ModelAPIError:
    """The error for an error's `body` that came with the status of a success; `status` is what the
    body calls itself."""
    if not 400 <= status <= 599:
        return ModelAPIError(model, said(body) or "an error without words")
    other = ModelServerError if status >= 500 else ModelRequestRejectedError
    kind: Any = {429: ModelRateLimitError, 503: ModelUnavailableError}.get(status, other)
    return ModelHTTPError.for_category(kind, status_code=status, model_name=model, body=body)


def _sent_on_to(error: BaseException) -> str | None:
    """The address to which a server sends on what it is asked; None: it does not."""
    for cause in causes(error):
        response = getattr(cause, "response", None)
        code = getattr(response, "status_code", None)
        if isinstance(code, int) and 300 <= code < 400:
            assert response is not None
            location = urljoin(str(response.url), response.headers.get("location", ""))
            try:
                return address(location)
            except ValueError:
                return "an address that is none"
    return None


def _systems(error: BaseException) -> str:
    """The deepest cause of an error: the operating system's words where it has some."""
    chain = [e for e in causes(error) if str(e)]
    for cause in reversed(chain):
        if isinstance(cause, ssl.SSLCertVerificationError):
            return f"certificate refused: {cause.verify_message}"
        if isinstance(cause, ssl.SSLError):
            return f"no TLS: {cause.reason or cause}"
        if isinstance(cause, OSError) and cause.errno is not None:
            is_name = isinstance(cause, socket.gaierror)
            return str(cause.strerror) if is_name else os.strerror(cause.errno)
    return str(chain[-1]) if chain else type(error).__name__


def _is_nobody(error: BaseException) -> bool:
    """Whether the connection failed for good: no such name, no such server, no trust in it."""
    return any(
        isinstance(e, ConnectionRefusedError | socket.gaierror | ssl.SSLError)
        for e in causes(error)
    )


def address(url: str) -> str:
    """A server's address without what may be secret in it."""
    parts = urlsplit(url)
    host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname
    port = f":{parts.port}" if parts.port else ""
    return f"{parts.scheme}://{host}{port}{parts.path.rstrip('/')}"
