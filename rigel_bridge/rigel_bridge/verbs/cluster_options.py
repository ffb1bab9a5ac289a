"""Flags of the commands that reach the cluster, and what they stand for."""

import argparse
import re
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from rigel_bridge.cluster.kubectl import Kubectl
from rigel_bridge.cluster.waiting import duration_s
from rigel_bridge.document.failures import printable
from rigel_bridge.source import Source, objects
from rigel_bridge.verbs.options import namespace

_APP: Final = re.compile(r"[a-z0-9]([-a-z0-9.]{0,251}[a-z0-9])?")


def add_cluster(parser: argparse.ArgumentParser) -> None:
    """How kubectl is called: `kubectl_of` makes it."""
    group = parser.add_argument_group("cluster")
    group.add_argument("--context", help="context of the kubeconfig (default: the current one)")
    group.add_argument("--kubeconfig", help="kubeconfig file (default: kubectl's own choice)")
    group.add_argument("--kubectl", default="kubectl", metavar="PATH", help="kubectl to run (default: the one on PATH)")


def kubectl_of(arguments: argparse.Namespace) -> Kubectl:
    given = {
        "--context": arguments.context,
        "--kubeconfig": arguments.kubeconfig,
        "--namespace": arguments.namespace,
    }
    return Kubectl(arguments.kubectl, flags=[f"{flag}={value}" for flag, value in given.items() if value])


def add_app(parser: argparse.ArgumentParser) -> None:
    """Options that choose an app of the cluster; `names_of` gives its names."""
    parser.add_argument(
        "app", nargs="?", type=app_name, help="name of the RobotApp (default: what ./Rigelfile becomes)"
    )
    parser.add_argument("-n", "--namespace", type=namespace, help="its namespace (default: kubectl's own)")
    add_cluster(parser)


def app_name(text: str) -> str:
    """An argument that names a RobotApp. Raises what argparse turns into wrong usage.

    Anything else than a name would mean something else to kubectl (a flag, a list, part of a selector), and an empty one, as a
    script passes it whose variable is not set, would be the app of the Rigelfile that happens to lie here.
    """
    if not _APP.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no name of a RobotApp; allowed: lower-case letters, digits and dashes, for example teleop"
        )
    return text


def names_of(arguments: argparse.Namespace) -> list[str]:
    """The name given, else those of the RobotApps that the Rigelfile of this folder becomes."""
    if arguments.app is not None:
        return [arguments.app]
    return [app["metadata"]["name"] for app in objects(Source(Path("Rigelfile"))).apps]


def seconds(text: str) -> float:
    """A duration as Kubernetes writes it (120s, 2m, 500ms) or a bare number of seconds. Raises what argparse turns into wrong usage."""
    seconds = duration_s(text)
    if seconds is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no duration; allowed: up to 24h, for example 30s, 2m or 500ms")
    return seconds


@contextmanager
def ended_like_ctrl_c() -> Iterator[None]:
    """A request to end (SIGTERM of a CI system, SIGHUP of a lost connection) cleans up as Ctrl-C does.

    A signal that is ignored, as `nohup` does it, stays ignored.
    """

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    wanted = [each for each in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(each) is not signal.SIG_IGN]
    before = [(each, signal.signal(each, interrupted)) for each in wanted]
    try:
        yield
    finally:
        for each, handler in before:
            signal.signal(each, handler)


def tell(line: str) -> None:
    """Progress and notes: one line to standard error, without what a terminal would act on."""
    sys.stderr.write(f"{printable(line)}\n")


def say(line: str) -> None:
    """A result: one line to standard output, made safe in the same way."""
    sys.stdout.write(f"{printable(line)}\n")


def subject(stored: dict[str, Any]) -> str:
    return f"robotapp/{stored['metadata']['name']} in namespace {stored['metadata']['namespace']}"
