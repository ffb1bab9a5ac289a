"""`python -m robotapp_scheduler simulate FILE…`: placements without a cluster."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO, TextIO

from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.config.load import ConfigError
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.simulation.dump import MOST_BYTES, Dump, DumpError, Reader
from robotapp_scheduler.simulation.report import Progress, as_json, as_table
from robotapp_scheduler.simulation.run import simulate
from robotapp_scheduler.watch.routes import kinds

MIB = 1 << 20


def main(argv: Sequence[str], *, stdin: BinaryIO | None = None, out: TextIO | None = None) -> int:
    """0 when it was simulated, whatever came of it; 2 when files or configuration cannot be used."""
    found = _parser().parse_args(argv)
    try:
        config = configuration.load(found.config, catalogue=catalogue())
        dump = read(found.files, most_bytes=found.max_mib * MIB, stdin=stdin or sys.stdin.buffer)
    except ConfigError as error:
        problems = (problem.removeprefix(f"{found.config}: ") for problem in error.problems)
        return _failed(*(f"{found.config}: {problem}" for problem in problems))
    except DumpError as error:
        return _failed(str(error))
    except OSError as error:
        return _failed(f"{error.filename}: {error.strerror}")
    progress = Progress(sys.stderr)
    try:
        outcome = simulate(dump, config, replay=found.replay, progress=progress)
    finally:
        progress.end()
    target = out or sys.stdout
    if found.json:
        json.dump(as_json(outcome), target, indent=2)
        target.write("\n")
    else:
        target.write(as_table(outcome))
    return 0


def read(files: Sequence[str], *, most_bytes: int, stdin: BinaryIO) -> Dump:
    """All files as one dump; "-" is standard input. Raises `DumpError` and `OSError`."""
    reader = Reader(kinds())
    left = most_bytes
    for name in files:
        if name == "-":
            content = stdin.read(left + 1)
        else:
            with Path(name).open("rb") as file:
                content = file.read(left + 1)
        if len(content) > left:
            raise DumpError(f"{name}: more than {most_bytes // MIB} MiB in all; allow more with --max-mib")
        left -= len(content)
        reader.add(content, name)
    return reader.dump


def _failed(*problems: str) -> int:
    for problem in problems:
        sys.stderr.write(f"error: {problem}\n")
    return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="robotapp-scheduler simulate",
        description="Places the waiting pods of a dump as the scheduler would, without a cluster.",
        epilog="example: kubectl get nodes,pods -A -o json | robotapp-scheduler simulate - --config scheduler.yaml",
    )
    parser.add_argument("files", nargs="+", metavar="FILE", help="JSON of Kubernetes objects; - is standard input")
    parser.add_argument("--config", type=Path, help="KubeSchedulerConfiguration file; default: built in")
    parser.add_argument(
        "--replay", type=_count, default=0, metavar="N", help="place the latest N bound pods again, too"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--max-mib", type=_count, default=MOST_BYTES // MIB, help="read no more than this (default 64)")
    return parser


def _count(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) < 10):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0 to 999999999")
    return int(text)
