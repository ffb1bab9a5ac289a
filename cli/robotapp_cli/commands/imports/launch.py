"""A launch file to a RobotApp and a report, by what ros_profile reads in the sources. Nothing of them is run."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from robotapp_cli.commands.imports.result import ImportOptions, check_output, read_pairs, write_objects, write_report
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.importing.report import Line, Verdict
from robotapp_cli.importing.services.draft import Json
from robotapp_cli.lint.marks import IMAGE_MARK

if TYPE_CHECKING:
    from ros_profile.model.conclusions import LaunchProfile, Profile

EVERY: Final = "*"
"""In place of a component's name: the image of all that have none of their own."""
_OPTION: Final = "import launch"


def import_launch(options: ImportOptions) -> None:
    """Writes the RobotApp of a launch file to standard output or a new file, and the report to standard error. Raises CliError."""
    _refuse_compose_options(options)
    check_output(options)
    images = read_pairs(options.images, "--image", "COMPONENT=IMAGE")
    profile = _read_sources(options.workspace or Path())
    from ros_profile.output.launch_choice import ChoiceError, choose_distro, choose_launch
    from ros_profile.output.robotapp import app

    try:
        launch = choose_launch(profile, str(options.files[1]) if len(options.files) > 1 else "", option=_OPTION)
        distro = choose_distro(profile, launch, options.distro)
    except ChoiceError as error:
        if unread := _find_unread(profile, str(options.files[1]) if len(options.files) > 1 else ""):
            text = (
                f"{unread}: is there, but cannot be read as a launch file; one of Python defines generate_launch_description(), one of "
                f"XML has <launch> as its root, one of YAML begins with launch:"
            )
            raise CliError(text, code=Exit.USAGE) from error
        raise CliError(str(error), code=Exit.USAGE) from error
    robotapp = app(launch, name=options.name or launch.package, distro=distro)
    _set_images(robotapp, images)
    write_objects([robotapp], options.output)
    lines = list(_report(launch, robotapp, distro))
    if not options.distro:
        text = f"{distro}, because no distribution is named; give --distro where it is another"
        lines.insert(0, Line(f"{launch.package}/{launch.file}", 1, "spec.ros.distro", Verdict.CHANGED, text))
    write_report(lines, options.report)


def _refuse_compose_options(options: ImportOptions) -> None:
    if len(options.files) > 2:
        text = f"{_OPTION} takes one PACKAGE/FILE, and not {len(options.files) - 1}; import each into an app of its own"
        raise CliError(text, code=Exit.USAGE)
    compose_options = {
        "--profile": options.profiles,
        "--env": options.env,
        "--env-file": options.env_files,
        "--project-directory": options.directory,
    }
    for option, value in compose_options.items():
        if value:
            raise CliError(f"{option} goes with compose files, not with {_OPTION}; leave it out", code=Exit.USAGE)


def _read_sources(workspace: Path) -> "Profile":
    """Returns what the packages of a folder need. Raises CliError where they cannot be read, or their readers are missing."""
    try:
        from ros_profile.generate import generate_profile
        from ros_profile.main import end_progress, find_cache_folder, show_progress
    except ImportError as error:
        text = f"{_OPTION} needs {error.name}: pip install '.[profile]' in a clone of RobotApp"
        raise CliError(text, code=Exit.USAGE) from error
    is_watched = sys.stderr.isatty()
    try:
        profile = generate_profile(workspace, cache=find_cache_folder(), progress=show_progress if is_watched else None)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise CliError(f"{workspace}: cannot be read: {reason}", code=Exit.USAGE) from error
    if is_watched:
        end_progress()
    if not profile.packages:
        text = f"{workspace}: no package.xml here or below that could be read; give the sources' folder as --workspace"
        raise CliError(text, code=Exit.USAGE)
    return profile


def _find_unread(profile: "Profile", wanted: str) -> Path | None:
    """Returns the file of that name, package/name or package/path, which the readers took for no launch file."""
    name, _, rest = wanted.partition("/")
    launches = {f"{package.name}/{launch.file}" for package in profile.packages for launch in package.launches}
    for package in profile.packages:
        paths = [rest] if name == package.name and rest else [wanted]
        for path in (*paths, *(f"launch/{path}" for path in paths)):
            file = Path(profile.path, package.path, path)
            if wanted and ".." not in file.parts and f"{package.name}/{path}" not in launches and file.is_file():
                return file
    return None


def _set_images(robotapp: Json, images: Mapping[str, str]) -> None:
    """Writes the images of --image into the components. Raises CliError for a component that is not there."""
    components = {component["name"]: component for component in robotapp["spec"]["components"]}
    if unknown_names := sorted(images.keys() - components.keys() - {EVERY}):
        names = ", ".join(components)
        raise CliError(f"--image {unknown_names[0]}: there is no such component; there are: {names}", code=Exit.USAGE)
    for name, component in components.items():
        component["image"] = images.get(name, images.get(EVERY, component["image"]))


def _report(launch: "LaunchProfile", robotapp: Json, distro: str) -> Iterator[Line]:
    """Yields a line per component, per image to choose, and per thing of the launch file that is not quite in the app."""
    from ros_profile.output.notes import list_notes
    from ros_profile.output.processes import components

    parts = components(launch.nodes)
    for part, body in zip(parts, robotapp["spec"]["components"], strict=True):
        first = part.nodes[0]
        programs = _list_programs([f"{node.package}/{node.plugin or node.executable}" for node in part.nodes])
        yield Line(first.file, first.line, part.name, Verdict.TAKEN, f"component {part.name}: {programs}")
        if body["image"] == IMAGE_MARK:
            text = f"no image is named; write the image, or give --image {part.name}=IMAGE"
            yield Line(first.file, first.line, part.name, Verdict.CHOOSE, text)
    for note in list_notes(launch, distro):
        verdict = Verdict.LEFT_OUT if note.lost else Verdict.CHANGED
        yield Line(note.file, note.line, note.subject or launch.file, verdict, note.text)


def _list_programs(names: Sequence[str]) -> str:
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return ", ".join(names[:4]) + more
