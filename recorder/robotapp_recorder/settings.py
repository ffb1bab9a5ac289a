"""Arguments of the recorder. Pure."""

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from robotapp_recorder.store import Limits
from robotapp_recorder.topics import Selection


@dataclass(frozen=True, slots=True)
class Settings:
    """Topics, folder and bounds of a recording."""

    name: str
    folder: Path
    selection: Selection
    limits: Limits


def make_parser() -> argparse.ArgumentParser:
    """Returns the parser of `robotapp-recorder`."""
    parser = argparse.ArgumentParser(prog="robotapp-recorder", description="Records topics of ROS 2 into MCAP files.")
    verbs = parser.add_subparsers(dest="verb", required=True)
    record = verbs.add_parser("record", help="record until SIGTERM")
    record.add_argument("--folder", type=Path, required=True, help="folder of the bags")
    record.add_argument("--name", required=True, help="beginning of their names")
    record.add_argument(
        "--topic", action="append", default=[], metavar="NAME", help="a topic, such as /scan; repeatable"
    )
    record.add_argument("--regex", default="", help="topics whose whole name matches this regular expression")
    record.add_argument("--exclude", default="", help="regular expression of topics that are left out")
    record.add_argument("--split-bytes", type=int, required=True, help="size of a bag")
    record.add_argument("--split-seconds", type=float, help="age at which a bag is closed")
    record.add_argument("--retain-bytes", type=int, required=True, help="what all bags together may take")
    for verb, text in (("list", "bags with size and state"), ("info", "topics and messages of one bag")):
        shown = verbs.add_parser(verb, help=f"{text}, as JSON")
        shown.add_argument("--folder", type=Path, required=True)
        if verb == "info":
            shown.add_argument("bag")
    return parser


def read_settings(arguments: Sequence[str]) -> Settings:
    """Returns the settings of `record`. Raises ValueError that names the wrong one."""
    read = make_parser().parse_args(["record", *arguments])
    for name in ("regex", "exclude"):
        try:
            re.compile(getattr(read, name))
        except re.error as error:
            raise ValueError(f"--{name} is no regular expression: {error}") from error
    if not read.topic and not read.regex:
        raise ValueError("nothing would be recorded: give --topic NAME or --regex PATTERN")
    if not 0 < read.split_bytes <= read.retain_bytes:
        raise ValueError("--split-bytes must be above 0 and at most --retain-bytes")
    split_ns = int(read.split_seconds * 1e9) if read.split_seconds is not None else None
    limits = Limits(split_bytes=read.split_bytes, retain_bytes=read.retain_bytes, split_ns=split_ns)
    selection = Selection(frozenset(read.topic), read.regex, read.exclude)
    return Settings(read.name, read.folder, selection, limits)
