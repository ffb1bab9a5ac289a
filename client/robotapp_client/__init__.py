"""Talking to the API server: `ApiClient` for verbs, `Reflector` for caches, `load` for the way there.

A name is imported when it is first used, so that a program that needs only a part, such as `serving.server`, loads only that.
"""

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from robotapp_client.api.client import ApiClient, Listing
    from robotapp_client.informer.reflector import Change, Reflector
    from robotapp_client.transport.errors import (
        AlreadyExists,
        ApiError,
        BadRequest,
        ClientError,
        Conflict,
        Forbidden,
        Gone,
        Invalid,
        LoginError,
        NamespaceTerminating,
        NotFound,
        ServerError,
        TooManyRequests,
        Unauthorized,
        Unreachable,
    )
    from robotapp_client.transport.kubeconfig import Endpoint, load

__all__ = [
    "AlreadyExists",
    "ApiClient",
    "ApiError",
    "BadRequest",
    "Change",
    "ClientError",
    "Conflict",
    "Endpoint",
    "Forbidden",
    "Gone",
    "Invalid",
    "Listing",
    "LoginError",
    "NamespaceTerminating",
    "NotFound",
    "Reflector",
    "ServerError",
    "TooManyRequests",
    "Unauthorized",
    "Unreachable",
    "load",
]
_ERRORS: Final = "transport.errors"
_MODULES: Final = {
    "ApiClient": "api.client",
    "Listing": "api.client",
    "Change": "informer.reflector",
    "Reflector": "informer.reflector",
    "Endpoint": "transport.kubeconfig",
    "load": "transport.kubeconfig",
}
"""Where a name is that is no error."""


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = importlib.import_module(f"{__name__}.{_MODULES.get(name, _ERRORS)}")
    return getattr(module, name)
