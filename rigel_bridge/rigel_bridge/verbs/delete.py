"""`rigel-bridge delete`: the app and everything of it."""

import argparse
from typing import Final

from rigel_bridge.cluster.removal import remove
from rigel_bridge.cluster.volume_claims import delete_claims
from rigel_bridge.cluster.waiting import Clock
from rigel_bridge.document.failures import Exit
from rigel_bridge.verbs.cluster_options import add_app, kubectl_of, names_of, say, seconds
from rigel_bridge.verbs.verb import Verb


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_app(parser)
    parser.add_argument(
        "--storage", action="store_true", help="delete the volume claims that apply made for it, with their data"
    )
    parser.add_argument(
        "--wait", type=seconds, default=120.0, metavar="DURATION", help="longest time until all is gone (default: 2m)"
    )


def _run(arguments: argparse.Namespace) -> int:
    kubectl = kubectl_of(arguments)
    for name in names_of(arguments):
        there = remove(kubectl, name, timeout_s=arguments.wait, clock=Clock())
        say(f"robotapp/{name}: {'deleted, with its pods and its history' if there else 'is not there'}")
        for claim in delete_claims(kubectl, name) if arguments.storage else ():
            say(f"persistentvolumeclaim/{claim}: deleted")
    return Exit.OK


DELETE: Final = Verb(
    name="delete",
    summary="delete the app, its pods and its history",
    description=(
        "Delete the RobotApp and return when nothing of it is left. Volume claims, ConfigMaps and whatever else it only names "
        "stay. An app that is not there is no error."
    ),
    arguments=_arguments,
    run=_run,
    examples=(
        ("rigel-bridge delete", "what ./Rigelfile became; volume claims stay"),
        ("rigel-bridge delete amr-teleop -n fleet --wait 5m", "an app by its name"),
        ("rigel-bridge delete amr-teleop --storage", "with its data"),
    ),
)
