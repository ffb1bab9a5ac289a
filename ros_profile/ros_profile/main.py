"""`ros-scheduler-profile`: the command line."""

import argparse
import os
import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from ros_profile.generate import ENGINES, generate_profile
from ros_profile.model.conclusions import Profile
from ros_profile.output.difference import difference
from ros_profile.output.launch_choice import ChoiceError, choose_distro, choose_launch
from ros_profile.output.machine import as_annotations, as_json, as_rigelfile, from_json
from ros_profile.output.robotapp import as_robotapp
from ros_profile.output.text import WIDTH, text

MAX_OLD_BYTES: Final = 256 << 20
CONTROL: Final = re.compile(
    "[\\x00-\\x09\\x0b-\\x1f\\x7f-\\x9f\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069\\ud800-\\udfff]"
)
"""What a terminal acts on instead of printing it, apart from the end of a line. rigel_bridge has the same (a test compares)."""
_EXAMPLES: Final = """\
examples:
  ros-scheduler-profile src/my_driver
      what the package needs, in short
  ros-scheduler-profile src/my_driver --explain
      with the lines of source it follows from
  ros-scheduler-profile src --format json > profile.json
      a workspace, for programs
  ros-scheduler-profile src --diff profile.json
      what has changed since
  ros-scheduler-profile src --format robotapp --launch bringup/robot.launch.py
      a launch file as a RobotApp; comments name what it lacks beside its images

exit codes:
  0 done   1 --diff found differences   2 wrong usage   130 Ctrl-C
  70 PATH or OLD cannot be read, or the result not written
  72 nothing to profile, or no launch file to make an app of

Nothing that is read is run: launch files, setup.py and CMakeLists.txt are only
parsed.
"""


class Failure(Exception):  # noqa: N818 - an outcome with its exit code
    """What ends the command. `code` becomes the exit code."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    if unused := _unused(arguments):
        parser.error(unused)
    try:
        profile = _profile(arguments)
        written, code = _output(profile, arguments)
        sys.stdout.write(CONTROL.sub(lambda match: f"\\u{ord(match[0]):04x}", written))
        sys.stdout.flush()
    except Failure as failure:
        sys.stderr.write(CONTROL.sub("?", f"{failure}\n"))
        return failure.code
    except KeyboardInterrupt:
        sys.stderr.write("\ninterrupted\n" if sys.stderr.isatty() else "interrupted\n")  # below the progress bar
        return 130
    except BrokenPipeError:  # `| head` closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # a full disk behind `>`: what was written is not all
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.stderr.write(f"standard output: cannot be written: {error.strerror}\n")
        return 70
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ros-scheduler-profile",
        description="Infer what ROS packages need from a scheduler, from their source, with evidence.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("path", type=Path, metavar="PATH", help="folder of a package or of a workspace, ROS 1 or ROS 2")
    parser.add_argument(
        "--format",
        choices=("text", "json", "annotations", "rigelfile", "robotapp"),
        default="text",
        metavar="FORMAT",
        help="text (default), json, annotations, rigelfile or robotapp",
    )
    parser.add_argument("--explain", action="store_true", help="with the evidence of every value (text)")
    parser.add_argument("--diff", type=Path, metavar="OLD", help="compare with a profile written by --format json")
    parser.add_argument(
        "--engine",
        choices=ENGINES,
        default="rules",
        help="rules (default); thesis: the heuristic it began with, to compare; none: only what is read, and edges",
    )
    parser.add_argument("--no-curated", action="store_true", help="without the table of well-known packages")
    parser.add_argument("--launch", metavar="FILE", help="launch file for robotapp: name, path, or package/path")
    parser.add_argument("--distro", help="ROS distribution for robotapp (default: jazzy, or noetic for ROS 1)")
    parser.add_argument("--no-cache", action="store_true", help="read everything again")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    return parser


def _unused(arguments: argparse.Namespace) -> str:
    """A flag that another format or --diff takes, and this call would pass over in silence."""
    for flag, given, form in (
        ("--launch", arguments.launch, "robotapp"),
        ("--distro", arguments.distro, "robotapp"),
        ("--explain", arguments.explain, "text"),
    ):
        if given and arguments.format != form:
            return f"{flag} goes with --format {form}, and this is --format {arguments.format}"
    if arguments.diff is not None and arguments.format != "text":
        return f"--diff writes lines of text: leave --format {arguments.format} out"
    return ""


def _profile(arguments: argparse.Namespace) -> Profile:
    if arguments.path.is_file():
        raise Failure(f"{arguments.path}: is a file; give the folder of a package or of a workspace", 70)
    try:
        profile = generate_profile(
            arguments.path,
            engine=arguments.engine,
            curated=not arguments.no_curated,
            cache=None if arguments.no_cache else find_cache_folder(),
            progress=None if arguments.quiet or not sys.stderr.isatty() else show_progress,
        )
    except (OSError, ValueError) as error:
        raise Failure(f"{arguments.path}: cannot be read: {getattr(error, 'strerror', None) or error}", 70) from error
    if sys.stderr.isatty() and not arguments.quiet:
        end_progress()
    if not profile.packages:
        reasons = "".join(f"; {problem.file}: {problem.message}" for problem in profile.problems[:3])
        raise Failure(f"{arguments.path}: no package.xml here or below that could be read{reasons}", 72)
    return profile


def find_cache_folder() -> Path | None:
    """Returns the folder for what was read, None for a user without a home."""
    stated = os.environ.get("XDG_CACHE_HOME")
    try:
        base = Path(stated) if stated else Path("~/.cache").expanduser()
    except RuntimeError:  # a user without a home
        return None
    return base / "ros-scheduler-profile" if base.is_absolute() else None


def show_progress(done: int, total: int, name: str) -> None:
    """A bar on a terminal's standard error, one line that is overwritten."""
    width = 24
    filled = width * done // max(total, 1)
    sys.stderr.write(f"\r\x1b[K[{'#' * filled}{' ' * (width - filled)}] {done}/{total} {CONTROL.sub('?', name)[:40]}")
    sys.stderr.flush()


def end_progress() -> None:
    """Clear the bar's line."""
    sys.stderr.write("\r\x1b[K")
    sys.stderr.flush()


def _output(profile: Profile, arguments: argparse.Namespace) -> tuple[str, int]:
    if arguments.diff is not None:
        lines = difference(_old(arguments.diff), profile)
        return "".join(line.replace("\n", "\\u000a") + "\n" for line in lines) or "no difference\n", 1 if lines else 0
    if arguments.format == "json":
        return as_json(profile), 0
    if arguments.format == "annotations":
        return as_annotations(profile), 0
    if arguments.format == "rigelfile":
        return as_rigelfile(profile), 0
    if arguments.format == "robotapp":
        return _robotapp(profile, arguments), 0
    return text(profile, explain=arguments.explain, width=_width()), 0


def _width() -> int:
    """Of the terminal; of what goes to a file or a pipe always the same."""
    return max(60, shutil.get_terminal_size().columns) if sys.stdout.isatty() else WIDTH


def _old(path: Path) -> Profile:
    try:
        with path.open("rb") as stream:
            data = stream.read(MAX_OLD_BYTES + 1)
        if len(data) > MAX_OLD_BYTES:
            raise Failure(f"{path}: is larger than {MAX_OLD_BYTES} bytes", 70)
        return from_json(data)
    except OSError as error:
        raise Failure(f"{path}: cannot be read: {error.strerror}", 70) from error
    except ValueError as error:
        raise Failure(f"{path}: {error}; write it with --format json", 70) from error


def _robotapp(profile: Profile, arguments: argparse.Namespace) -> str:
    try:
        launch = choose_launch(profile, arguments.launch or "", option="--launch")
        distro = choose_distro(profile, launch, arguments.distro or "")
    except ChoiceError as error:
        raise Failure(str(error), 2 if error.is_usage else 72) from error
    return as_robotapp(launch, name=launch.package, distro=distro)


if __name__ == "__main__":
    sys.exit(main())
