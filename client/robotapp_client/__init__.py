"""Talking to the API server: `ApiClient` for verbs, `Reflector` for caches, `kubeconfig.load` for the way there."""

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
    "NotFound",
    "Reflector",
    "ServerError",
    "TooManyRequests",
    "Unauthorized",
    "Unreachable",
    "load",
]
