"""Talking to the API server: `ApiClient` for verbs, `Reflector` for caches, `login.load` for the way there."""

from robotapp_api.client.api import ApiClient, Listing
from robotapp_api.client.errors import (
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
from robotapp_api.client.login import Endpoint, load
from robotapp_api.client.reflector import Change, Reflector

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
