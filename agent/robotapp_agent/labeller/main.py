"""`python -m robotapp_agent.labeller`: read flags, then run until stopped."""

import argparse
import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Coroutine, Sequence
from pathlib import Path
from typing import Any

from robotapp_agent.labeller.labeller import MANAGER, Labeller
from robotapp_agent.labeller.wanted import KEPT_S
from robotapp_agent.process import logs
from robotapp_client.api.client import ApiClient
from robotapp_client.tools.event_recorder import EventRecorder
from robotapp_client.transport.errors import LoginError
from robotapp_client.transport.kubeconfig import Endpoint, load
from robotapp_client.transport.metadata import MetadataTransport


def main(argv: Sequence[str] | None = None) -> int:
    """0 after a clean stop, 2 when flags or credentials cannot be used."""
    options = parse(argv)
    logs.set_up(options.log_format, options.log_level)
    try:
        endpoint = load(options.kubeconfig)
    except LoginError as error:
        print(f"robotapp-labeller: {error}", file=sys.stderr)  # noqa: T201 - for the person who started us
        return 2
    asyncio.run(_run(endpoint, kept_s=options.keep_seconds))
    return 0


async def _run(endpoint: Endpoint, *, kept_s: float) -> None:
    heads = MetadataTransport(endpoint, user_agent=MANAGER, max_connections=2)
    async with (
        ApiClient(endpoint, user_agent=MANAGER, field_manager=MANAGER, max_connections=4) as client,
        ApiClient(endpoint, user_agent=MANAGER, transport=heads) as watcher,
    ):
        recorder = EventRecorder(client, controller=MANAGER, instance=os.environ.get("HOSTNAME", MANAGER))
        labeller = Labeller(client, watcher, recorder=recorder, kept_s=kept_s)
        work = asyncio.create_task(_together(labeller.run(), recorder.run()))
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, work.cancel)
        with contextlib.suppress(asyncio.CancelledError):
            await work


async def _together(*parts: Coroutine[Any, Any, None]) -> None:
    async with asyncio.TaskGroup() as group:
        for part in parts:
            group.create_task(part)


def parse(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """Exits with a usage text on a mistake, as argparse does."""
    parser = argparse.ArgumentParser(
        prog="robotapp-labeller",
        description="Writes the devices that the agents found as labels hardware.robotics.io/* of the nodes.",
    )
    parser.add_argument("--kubeconfig", type=Path, help="default: the service account of the pod it runs in")
    parser.add_argument(
        "--keep-seconds",
        type=_seconds,
        default=KEPT_S,
        metavar="S",
        help=f"how long labels stay after their device went; default: {KEPT_S:g}",
    )
    parser.add_argument("--log-format", choices=("text", "json"), default="text")
    parser.add_argument("--log-level", choices=("debug", "info", "warning", "error"), default="info")
    return parser.parse_args(argv)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 86_400:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds from 0 to 86400")
    return value
