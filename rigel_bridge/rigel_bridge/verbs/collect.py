"""`rigel-bridge collect`: state, logs and result files of an app into a folder."""

import argparse
from pathlib import Path
from typing import Final

from rigel_bridge.cluster import apps
from rigel_bridge.cluster.results import collect, opened
from rigel_bridge.document.failures import Exit
from rigel_bridge.verbs.cluster_options import add_app, kubectl_of, names_of, say, tell
from rigel_bridge.verbs.verb import Verb


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, help="new or empty folder; with several apps each gets one below it")
    add_app(parser)
    parser.add_argument(
        "--path",
        default="",
        help="folder in the containers that holds results (default: results.source_path of the Rigelfile)",
    )


def _run(arguments: argparse.Namespace) -> int:
    kubectl, names = kubectl_of(arguments), names_of(arguments)
    for name in names:
        app = apps.existing(kubectl, name)
        into = opened(arguments.folder / name if len(names) > 1 else arguments.folder)
        collect(kubectl, app, into, tell=tell, path=arguments.path)
        into.close()
        say(f"robotapp/{name}: {len(into.sums)} files in {into.folder}")
    return Exit.OK


COLLECT: Final = Verb(
    name="collect",
    summary="copy state, logs and result files into a folder",
    description=(
        "Copy what the app shows of itself: the RobotApp, its instances and pods as JSON, logs of at most 1 MiB, and the result "
        "files of the newest ready pod of each component (256 MiB; the container needs tar). manifest.json has a checksum of each."
    ),
    arguments=_arguments,
    run=_run,
    examples=(
        ("rigel-bridge collect results/today", "of what ./Rigelfile became"),
        ("rigel-bridge collect out amr-teleop --path /results", "result files of a folder in the containers"),
    ),
)
