"""Exit codes, and how an error becomes one or two lines for a person."""

import re
import sys
from enum import IntEnum
from typing import Final

import typer

from robotapp_api.values.printable import printable
from robotapp_client.transport.errors import (
    ApiError,
    ClientError,
    Forbidden,
    LoginError,
    NotFound,
    Unauthorized,
    Unreachable,
)

_DENIED: Final = re.compile(r'cannot (\w+) resource "([a-z]+)')
_READING: Final = frozenset({"get", "list", "watch"})
_OF_THE_FLEET: Final = frozenset({"nodes", "robotclaims", "domainpools", "nodetelemetries"})
"""Resources of the chart's ClusterRole robotapp-cluster-viewer."""


class Exit(IntEnum):
    """Exit codes of kubectl-robotapp, listed in --help."""

    OK = 0
    REFUSED = 1
    """By the API server, or by `lint`."""
    USAGE = 2
    UNREACHABLE = 3
    NOT_FOUND = 4


class CliError(Exception):
    """A message for the user: what is wrong and what to do."""

    def __init__(self, message: str, *, code: Exit = Exit.REFUSED) -> None:
        super().__init__(message)
        self.code = code


def ended_by(failure: CliError) -> typer.Exit:
    """Print the failure; the caller raises what is returned, which ends the process with its exit code."""
    sys.stderr.write(f"error: {printable(str(failure))}\n")
    return typer.Exit(failure.code)


def explained(error: ClientError) -> CliError:
    """The user's side of an error of the client."""
    if isinstance(error, NotFound):
        return CliError(f"{error.message}{_crds(error)}", code=Exit.NOT_FOUND)
    if isinstance(error, Forbidden):
        return CliError(f"you may not do this: {error.message}\n{_rights(error.message)}")
    if isinstance(error, Unauthorized):
        return CliError(
            f"the API server does not know you: {error.message}\nSign in again, or choose another --context.",
            code=Exit.UNREACHABLE,
        )
    if isinstance(error, LoginError):
        return CliError(str(error), code=Exit.UNREACHABLE)
    if isinstance(error, Unreachable):
        return CliError(
            f"the API server cannot be reached: {error}\nTry kubectl version; --context or --kubeconfig choose another cluster.",
            code=Exit.UNREACHABLE,
        )
    return CliError(error.message if isinstance(error, ApiError) else str(error))


def _rights(message: str) -> str:
    """The binding that would help. `message` is the API server's, which names verb, resource and namespace."""
    found = _DENIED.search(message)
    verb, plural = found.groups() if found else ("", "")
    role = "view" if verb in _READING else "edit"
    if plural in _OF_THE_FLEET:
        return "Ask for a ClusterRoleBinding of robotapp-cluster-viewer (nodes, claims, pools, telemetry)."
    if plural and " at the cluster scope" in message:
        return f"Ask for a ClusterRoleBinding of {role}: a RoleBinding of it counts in its own namespace only."
    if plural:
        return f"Ask for a RoleBinding of ClusterRole {role} in that namespace."
    return (
        "Ask for ClusterRole view in the namespace, or robotapp-cluster-viewer for nodes, claims, pools and telemetry."
    )


def _crds(error: NotFound) -> str:
    if "could not find the requested resource" in error.message:
        return "\nRobotApp is not installed in this cluster: docs/installation.md has the steps."
    return "\nkubectl robotapp list -A shows what there is."
