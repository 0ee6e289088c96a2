# SPDX-License-Identifier: Apache-2.0
"""The exceptions of this package. All are subclasses of `Error`."""

from __future__ import annotations


class Error(Exception):
    """What went wrong, in the words of the daemon where it answered.

    Attributes
    ----------
    code : int
        The HTTP status, or the JSON-RPC code of a stream (negative). 0: there was no answer.
    detail : str
        What is wrong, the limit, and the remedy.
    pointer : str
        JSON pointer (RFC 6901) to the wrong field of the request. Empty: no field caused the error.
    """

    def __init__(self, detail: str, code: int = 0, pointer: str = "") -> None:
        super().__init__(f"{pointer}: {detail}" if pointer else detail)
        self.code = code
        self.detail = detail
        self.pointer = pointer

    def __reduce__(self):
        return type(self), (self.detail, self.code, self.pointer)


class ConnectionFailed(Error):
    """The daemon cannot be reached, or ended before it answered."""


class StartFailed(Error):
    """The daemon could not be started."""


class IncompatibleVersion(Error):
    """The daemon does not have the interface that this package needs."""


class Unauthorized(Error):
    """The token is missing or wrong, or its role does not allow the request (401, 403)."""


class NotFound(Error):
    """There is no such volume, view, path or session (404)."""


class InvalidRequest(Error):
    """A field of the request is wrong; `pointer` names it (400, 413, 415, 422)."""


class NotReady(Error):
    """A volume is still being loaded, or a path still being rendered (409)."""


class OverLimit(Error):
    """The daemon or the quota of the token has no capacity for this request now (429, 503, 507)."""


class LoadFailed(Error):
    """A volume could not be loaded. The text names the file and the place in it."""


class PathFailed(Error):
    """A camera path could not be rendered."""


_BY_STATUS: dict[int, type[Error]] = {
    400: InvalidRequest,
    401: Unauthorized,
    403: Unauthorized,
    404: NotFound,
    409: NotReady,
    413: InvalidRequest,
    415: InvalidRequest,
    422: InvalidRequest,
    429: OverLimit,
    503: OverLimit,
    507: OverLimit,
}

_BY_RPC_CODE: dict[int, type[Error]] = {
    -32000: InvalidRequest,
    -32001: InvalidRequest,
    -32002: NotFound,
    -32003: NotReady,
    -32004: Unauthorized,
    -32005: OverLimit,
    -32007: Unauthorized,
    -32601: IncompatibleVersion,
    -32602: InvalidRequest,
}


def of_status(status: int, detail: str, pointer: str = "") -> Error:
    """The exception for an HTTP status of 400 or more."""
    return _BY_STATUS.get(status, Error)(detail, status, pointer)


def of_rpc_code(code: int, detail: str, pointer: str = "") -> Error:
    """The exception for an error of the stream."""
    return _BY_RPC_CODE.get(code, Error)(detail, code, pointer)
