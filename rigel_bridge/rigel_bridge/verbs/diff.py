"""`rigel-bridge diff`: what an apply would change, as the API server computes it."""

import argparse
import sys
from typing import Final

from rigel_bridge.cluster import apps
from rigel_bridge.cluster.differences import diff
from rigel_bridge.document.failures import Exit, printable
from rigel_bridge.verbs.cluster_options import add_cluster, kubectl_of
from rigel_bridge.verbs.options import add_source, objects_of
from rigel_bridge.verbs.verb import Verb


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_source(parser)
    add_cluster(parser)


def _run(arguments: argparse.Namespace) -> int:
    kubectl, code = kubectl_of(arguments), Exit.OK
    for app in objects_of(arguments).apps:
        name = app["metadata"]["name"]
        stored = apps.read(kubectl, name) or {"spec": {}}
        wanted = apps.apply(kubectl, app, dry_run=True)
        text = diff(stored["spec"], wanted["spec"], before=f"cluster/{name}", after=f"rigelfile/{name}")
        if text:
            code = Exit.DIFFERENT
            sys.stdout.writelines(f"{printable(line)}\n" for line in text.splitlines())
    return code


DIFF: Final = Verb(
    name="diff",
    summary="show what apply would change",
    description=(
        "Compare the stored spec with what `apply` would make of it; nothing is written. Empty and exit code 0 when they are "
        "equal, 1 when they differ."
    ),
    arguments=_arguments,
    run=_run,
    examples=(
        ("rigel-bridge diff", "what `apply` of ./Rigelfile would change"),
        ("rigel-bridge diff -n fleet ws/Rigelfile", "in a namespace"),
    ),
)
