"""`rigel-bridge render`: the RobotApp as YAML, on the screen or in a file."""

import argparse
import sys
from pathlib import Path
from typing import Final

from rigel_bridge.document.failures import BridgeError, Exit, Place, printable
from rigel_bridge.render.text import as_yaml
from rigel_bridge.render.workloads import FORMATS, workloads
from rigel_bridge.source import objects
from rigel_bridge.verbs.options import add_source, source_of, tell_notes
from rigel_bridge.verbs.verb import Verb


def _arguments(parser: argparse.ArgumentParser) -> None:
    add_source(parser)
    parser.add_argument(
        "--format",
        choices=FORMATS,
        default=FORMATS[0],
        help="robotapp (default); pods: Deployments with the thesis' annotations; manifests: Deployments for any scheduler",
    )
    parser.add_argument("-o", "--output", type=Path, help="file to write instead of standard output")


def _run(arguments: argparse.Namespace) -> int:
    found = objects(source_of(arguments))
    documents, notes = found.documents, found.notes
    if arguments.format != FORMATS[0]:
        plain = [workloads(one, annotated=arguments.format == "pods") for one in found.rendered]
        documents = tuple(document for written, _ in plain for document in written)
        notes = tuple(dict.fromkeys([*found.rigelfile.notes, *(note for _, more in plain for note in more)]))
    tell_notes(notes, arguments)
    comments = "".join(f"# {printable(remark)}\n" for remark in found.remarks)
    write(comments + as_yaml(documents), arguments.output)
    return Exit.OK


def write(text: str, output: Path | None) -> None:
    """The text to a file, or to standard output for None; BridgeError when that fails."""
    try:
        if output is None:
            sys.stdout.write(text)
            sys.stdout.flush()
        else:
            output.write_text(text, encoding="utf-8")
    except BrokenPipeError:
        raise
    except OSError as error:
        place = Place(str(output or "standard output"))
        raise BridgeError(place, f"cannot be written: {error.strerror}", code=Exit.UNREADABLE) from error


RENDER: Final = Verb(
    name="render",
    summary="write the RobotApp as YAML",
    description="Write the RobotApp of a Rigelfile as YAML.",
    arguments=_arguments,
    run=_run,
    examples=(
        ("rigel-bridge render", "the Rigelfile of this folder, to the screen"),
        ("rigel-bridge render ws/Rigelfile | kubectl apply -f -", "straight to the cluster"),
        ("git show v1:Rigelfile | rigel-bridge render - --name amr-teleop", "from standard input"),
        ("rigel-bridge render --name amr-teleop -o k8s/teleop.yaml", "to a file"),
        ("rigel-bridge render --sequence benchmark_default", "the jobs of a sequence that deploy"),
        ("rigel-bridge render --format pods", "annotated Deployments, without the operator"),
        ("rigel-bridge render --profile src", "with wishes read from the packages' sources"),
        ("TAG=1.4.0 rigel-bridge render --env TAG", "{{ TAG }} from the environment"),
    ),
)
