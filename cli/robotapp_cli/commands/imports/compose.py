"""Compose files to a RobotApp and a report. The files are read here; what becomes of them is decided in `importing`."""

import os
from pathlib import Path
from typing import Final

from robotapp_api.model.distros import DISTROS, NO_DISTRO
from robotapp_cli.commands.imports.result import ImportOptions, check_output, read_pairs, write_objects, write_report
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.importing.app import import_compose
from robotapp_cli.importing.files.project import ImportRequest
from robotapp_cli.importing.report import ComposeError
from robotapp_cli.lint.reading import MOST_TEXT

_NAMES: Final = ("compose.yaml", "compose.yml", "docker-compose.yaml", "docker-compose.yml")


def import_compose_files(options: ImportOptions) -> None:
    """Writes the RobotApp to standard output or a new file, and the report to standard error. Raises CliError."""
    if options.distro and options.distro != NO_DISTRO and options.distro not in DISTROS:
        raise CliError(f"--distro {options.distro}: no such ROS distribution; write for example jazzy", code=Exit.USAGE)
    check_output(options)
    files = [_find_file(file) for file in options.files]
    request = ImportRequest(
        files=[os.path.normpath(file) for file in files],
        directory=str(options.directory or files[0].parent.absolute()),
        name=options.name,
        distro=options.distro,
        images=read_pairs(options.images, "--image", "SERVICE=IMAGE"),
        variables=read_pairs(options.env, "--env", "NAME=VALUE"),
        defaults={"HOME": str(Path.home()), "PWD": str(options.directory or files[0].parent.absolute())},
        env_files=[os.path.normpath(file) for file in options.env_files],
        profiles=frozenset(options.profiles),
    )
    try:
        result = import_compose(request, read_plain_file)
    except ComposeError as error:
        raise CliError(str(error), code=Exit.USAGE) from error
    write_objects(result.objects, options.output)
    write_report(result.report.sort(), options.report)


def _find_file(path: Path) -> Path:
    """Returns the compose file of a folder, or the file itself."""
    if not path.is_dir():
        return path
    for name in _NAMES:
        if (path / name).is_file():
            return path / name
    text = f"{path} has no {', '.join(_NAMES)}; give the FILE"
    if (path / "package.xml").is_file() or next(path.glob("*/package.xml"), None):
        text += f", or for a launch file: kubectl robotapp import launch PACKAGE/FILE --workspace {path}"
    raise CliError(text, code=Exit.USAGE)


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
