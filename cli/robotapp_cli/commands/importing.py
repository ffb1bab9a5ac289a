"""`import`: compose files to a RobotApp and a report. The files are read here; what becomes of them is decided in `importing`."""

import json
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from robotapp_api.model.distros import DISTROS, NO_DISTRO
from robotapp_api.values.printable import printable
from robotapp_cli.failures import CliError, Exit, ended_by
from robotapp_cli.importing.app import ImportResult, import_compose
from robotapp_cli.importing.files.project import ImportRequest
from robotapp_cli.importing.report import ComposeError, Line, Verdict
from robotapp_cli.importing.writing import format_objects
from robotapp_cli.lint.reading import MOST_TEXT
from robotapp_cli.written import object_name

_NAMES: Final = ("compose.yaml", "compose.yml", "docker-compose.yaml", "docker-compose.yml")


class ReportForm(StrEnum):
    """Values of --report."""

    TEXT = "text"
    JSON = "json"


_EPILOG: Final = (
    "Examples: kubectl robotapp import compose.yaml -o app.yaml; "
    "kubectl robotapp import compose.yaml compose.robot.yaml --profile robot --image driver=registry.example/driver:1.2"
)
Files = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE...", help="Compose file, or a folder with one; later files are merged into the first."
    ),
]
OutputFile = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FILE", help="New file for the result (default: standard output)."),
]
Form = Annotated[ReportForm, typer.Option("--report", help="Form of the report, which goes to standard error.")]
Profiles = Annotated[
    list[str] | None, typer.Option("--profile", help="Import the services of this profile, too. Can be repeated.")
]
Variables = Annotated[
    list[str] | None,
    typer.Option("--env", metavar="NAME=VALUE", help="Variable for the file's values. Can be repeated."),
]
EnvFiles = Annotated[
    list[Path] | None,
    typer.Option("--env-file", help="File with variables (default: .env beside the first file). Can be repeated."),
]
Images = Annotated[
    list[str] | None,
    typer.Option(
        "--image", metavar="SERVICE=IMAGE", help="Image of a service, such as one that is built. Can be repeated."
    ),
]
DistroName = Annotated[str, typer.Option("--distro", help="ROS distribution (default: as the images say).")]
AppName = Annotated[
    str | None,
    typer.Option("--name", help="Name of the RobotApp (default: the file's, else its folder's).", callback=object_name),
]
ProjectDirectory = Annotated[
    Path | None,
    typer.Option(
        "--project-directory",
        help="Where the folder of the compose file is on the nodes (default: where it is here); relative paths count from it.",
    ),
]


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """The command line of `import`."""

    files: Sequence[Path]
    output: Path | None = None
    report: ReportForm = ReportForm.TEXT
    profiles: Sequence[str] = ()
    env: Sequence[str] = ()
    env_files: Sequence[Path] = ()
    images: Sequence[str] = ()
    distro: str = ""
    name: str = ""
    directory: Path | None = None


def add_import_command(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("import", epilog=_EPILOG)(import_command)


def import_command(
    files: Files,
    *,
    output: OutputFile = None,
    report: Form = ReportForm.TEXT,
    profile: Profiles = None,
    env: Variables = None,
    env_file: EnvFiles = None,
    image: Images = None,
    distro: DistroName = "",
    name: AppName = None,
    project_directory: ProjectDirectory = None,
) -> None:
    """Write a RobotApp from compose files, and report what was taken, changed and left out. Nothing is sent to a cluster."""
    options = ImportOptions(
        files=files,
        output=output,
        report=report,
        profiles=profile or (),
        env=env or (),
        env_files=env_file or (),
        images=image or (),
        distro=distro,
        name=name or "",
        directory=project_directory,
    )
    try:
        import_files(options)
    except CliError as failure:
        raise ended_by(failure) from failure


def import_files(options: ImportOptions) -> None:
    """Writes the RobotApp to standard output or a new file, and the report to standard error. Raises CliError."""
    if options.distro and options.distro != NO_DISTRO and options.distro not in DISTROS:
        raise CliError(f"--distro {options.distro}: no such ROS distribution; write for example jazzy", code=Exit.USAGE)
    if options.output is not None and options.output.exists():
        raise CliError(f"{options.output} exists and is not overwritten; give another name", code=Exit.USAGE)
    files = [_find_file(file) for file in options.files]
    request = ImportRequest(
        files=[os.path.normpath(file) for file in files],
        directory=str(options.directory or files[0].parent.absolute()),
        name=options.name,
        distro=options.distro,
        images=_read_pairs(options.images, "--image", "SERVICE=IMAGE"),
        variables=_read_pairs(options.env, "--env", "NAME=VALUE"),
        defaults={"HOME": str(Path.home()), "PWD": str(options.directory or files[0].parent.absolute())},
        env_files=[os.path.normpath(file) for file in options.env_files],
        profiles=frozenset(options.profiles),
    )
    try:
        result = import_compose(request, read_plain_file)
    except ComposeError as error:
        raise CliError(str(error), code=Exit.USAGE) from error
    _write_objects(result, options.output)
    _write_report(result, options.report)


def _find_file(path: Path) -> Path:
    """Returns the compose file of a folder, or the file itself."""
    if not path.is_dir():
        return path
    for name in _NAMES:
        if (path / name).is_file():
            return path / name
    raise CliError(f"{path} has no {', '.join(_NAMES)}; give the FILE", code=Exit.USAGE)


def _read_pairs(texts: Iterable[str], option: str, form: str) -> Mapping[str, str]:
    pairs = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise CliError(f"{option} {text}: write {option} {form}", code=Exit.USAGE)
        pairs[name] = value
    return pairs


def read_plain_file(name: str) -> bytes | None:
    """Returns the content of a regular file, None for what is none, a symbolic link, or cannot be read."""
    path = Path(name)
    try:
        if path.is_symlink() or not path.is_file():
            return None
        with path.open("rb") as file:
            return file.read(MOST_TEXT + 1)
    except (OSError, ValueError):
        return None


def _write_objects(result: ImportResult, output: Path | None) -> None:
    text = format_objects(result.objects)
    if output is None:
        sys.stdout.write(text)
        return
    try:
        with output.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise CliError(f"{output} cannot be written: {error.strerror}", code=Exit.USAGE) from error


def _write_report(result: ImportResult, form: ReportForm) -> None:
    lines = result.report.sort()
    if form is ReportForm.JSON:
        data = {"lines": [_describe(line) for line in lines], **_count(lines)}
        sys.stderr.write(json.dumps(data, indent=2) + "\n")
        return
    for line in lines:
        text = f"{line.file}:{line.line}: {line.verdict}: {line.path}: {line.message}"
        sys.stderr.write(printable(text).replace("\n", r"\n") + "\n")
    counts = ", ".join(f"{count} {name}" for name, count in _count(lines).items())
    sys.stderr.write(f"{counts}. Next: kubectl robotapp lint FILE\n")


def _describe(line: Line) -> dict[str, Any]:
    return {
        "file": line.file,
        "line": line.line,
        "path": line.path,
        "verdict": line.verdict.value,
        "message": line.message,
    }


def _count(lines: Sequence[Line]) -> dict[str, int]:
    names = {Verdict.TAKEN: "taken", Verdict.CHANGED: "changed", Verdict.LEFT_OUT: "leftOut", Verdict.CHOOSE: "choose"}
    return {name: sum(line.verdict is verdict for line in lines) for verdict, name in names.items()}
