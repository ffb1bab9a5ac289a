"""One command's connection: which cluster, which namespace, and how errors end the process."""

import asyncio
import shlex
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

import typer

from robotapp_api.values.arguments import is_name
from robotapp_cli.failures import CliError, ended_by, explained
from robotapp_cli.output import Output
from robotapp_client.api.client import ApiClient
from robotapp_client.transport.errors import ClientError
from robotapp_client.transport.kubeconfig import Endpoint, default_kubeconfigs, load

T = TypeVar("T")
_TIMEOUT_S = 15.0
INTERRUPTED: Final = 130
"""Exit code after Ctrl-C, as shells have it: 128 and the number of SIGINT."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What every command takes. `namespace` None means the context's; `everywhere` all of them."""

    namespace: str | None = None
    everywhere: bool = False
    context: str | None = None
    kubeconfig: Path | None = None
    output: Output = Output.TABLE


@dataclass(frozen=True, slots=True)
class Session:
    """An open client and the namespace to look in (None: all)."""

    client: ApiClient
    namespace: str | None
    options: Options

    @property
    def home(self) -> str:
        """The namespace for objects asked by name."""
        return self.options.namespace or self.client.endpoint.namespace

    def write_command(self, *words: str) -> str:
        """Returns a command of this program for people to paste, with the namespace and cluster that this one was given."""
        options = self.options
        flags = (("-n", options.namespace), ("--context", options.context), ("--kubeconfig", options.kubeconfig))
        flag_words = [text for option, value in flags if value for text in (option, str(value))]
        return shlex.join(["kubectl", "robotapp", *words, *flag_words])


def endpoint(options: Options) -> Endpoint:
    """The cluster kubectl would talk to."""
    files = [options.kubeconfig] if options.kubeconfig else default_kubeconfigs()
    return load(files or None, options.context)


def run(options: Options, work: Callable[[Session], Awaitable[T]]) -> T:
    """Do the work; a failure is printed without a traceback and ends the process with its exit code."""
    try:
        return asyncio.run(_connected(options, work))
    except KeyboardInterrupt:  # how `logs -f` and `-w` end
        raise typer.Exit(INTERRUPTED) from None
    except ClientError as error:
        failure = explained(error)
    except CliError as error:
        failure = error
    raise ended_by(failure)


async def _connected(options: Options, work: Callable[[Session], Awaitable[T]]) -> T:
    where = endpoint(options)
    if not is_name(where.namespace):
        raise CliError(
            f"the kubeconfig's context names the namespace {where.namespace!r}, which no namespace can be called"
        )
    async with ApiClient(where, user_agent="kubectl-robotapp", timeout_s=_TIMEOUT_S) as client:
        namespace = None if options.everywhere else options.namespace or where.namespace
        return await work(Session(client, namespace, options))
