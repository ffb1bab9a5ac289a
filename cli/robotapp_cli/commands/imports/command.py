"""`import`: the command line of both imports."""

from pathlib import Path
from typing import Annotated, Final

import typer

from robotapp_cli.commands.imports.compose import import_compose_files
from robotapp_cli.commands.imports.launch import import_launch
from robotapp_cli.commands.imports.result import ImportOptions, ReportForm
from robotapp_cli.failures import CliError, ended_by
from robotapp_cli.written import object_name

LAUNCH: Final = "launch"
"""First word of the command line of a launch file."""
_EPILOG: Final = (
    "Examples: kubectl robotapp import compose.yaml -o app.yaml; "
    "kubectl robotapp import compose.yaml --image driver=r/driver:1; "
    "kubectl robotapp import launch bringup/robot.launch.py --workspace src"
)
Files = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE...",
        help="Compose file, or a folder with one; later files are merged into the first. Or the word launch and PACKAGE/FILE.",
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
        "--image",
        metavar="SERVICE=IMAGE",
        help="Image of a service, such as one that is built, or of a component. Can be repeated.",
    ),
]
DistroName = Annotated[
    str, typer.Option("--distro", help="ROS distribution (default: as the images or the package say).")
]
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
Workspace = Annotated[
    Path | None,
    typer.Option("--workspace", help="With launch: folder of the packages' sources (default: the present one)."),
]


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
    workspace: Workspace = None,
) -> None:
    """Write a RobotApp from compose files or from a launch file, and report what was taken, changed and left out. Nothing is sent to a cluster."""
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
        workspace=workspace,
    )
    try:
        if str(files[0]) == LAUNCH:
            import_launch(options)
        else:
            import_compose_files(options)
    except CliError as failure:
        raise ended_by(failure) from failure
