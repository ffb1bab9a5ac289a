"""Compose files to one project: include, extends, profiles, several files, and the variables of each."""

import posixpath
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from robotapp_cli.importing.files.interpolation import InterpolationError, parse_env_file
from robotapp_cli.importing.files.merging import merge, place_services
from robotapp_cli.importing.files.parts import Part, read_parts
from robotapp_cli.importing.report import ComposeError, Report

ReadFile = Callable[[str], bytes | None]
"""Returns the content of a file, None for what is no readable file."""
_DEEPEST: Final = 16
_MOST_FILES: Final = 100
_NAMED: Final = ("services", "volumes", "configs", "secrets", "networks")
EXTENSION: Final = "x-robotapp"
"""What compose has no words for, in those of RobotApp: at the top of a file and in a service."""
_TOP: Final = frozenset({*_NAMED, "include", "name", EXTENSION})


@dataclass(frozen=True, slots=True)
class ImportRequest:
    """The files to import, and what is given on the command line."""

    files: Sequence[str]
    directory: str = "/"
    """Absolute path of the folder of the first file, on the nodes."""
    name: str = ""
    distro: str = ""
    images: Mapping[str, str] = field(default_factory=dict)
    """Images by service, in place of those of the file."""
    variables: Mapping[str, str] = field(default_factory=dict)
    defaults: Mapping[str, str] = field(default_factory=dict)
    """Variables that every shell has; all others come from the command line and from env files."""
    env_files: Sequence[str] = ()
    profiles: frozenset[str] = frozenset()


@dataclass(slots=True)
class Project:
    """All services and what they refer to, merged."""

    name: str = ""
    services: dict[str, Part] = field(default_factory=dict)
    volumes: dict[str, Part] = field(default_factory=dict)
    configs: dict[str, Part] = field(default_factory=dict)
    secrets: dict[str, Part] = field(default_factory=dict)
    networks: dict[str, Part] = field(default_factory=dict)
    extension: Part | None = None


@dataclass(slots=True)
class Loader:
    """Reads the files of one import. A relative path counts from the folder of the file in which it is written."""

    read_file: ReadFile
    request: ImportRequest
    report: Report
    variables: dict[str, dict[str, str]] = field(default_factory=dict)
    """Variables by file."""
    roots: dict[str, Part] = field(default_factory=dict)
    folders: dict[str, str] = field(default_factory=dict)
    """Folders that an include names, by file, where they are not the file's own."""

    def load(self) -> Project:
        """Returns the merged project. Raises ComposeError."""
        project = Project()
        base = self._read_variables(self.request.files[0])
        for file in self.request.files:
            self._add_file(project, file, base, depth=0)
        project.services = place_services(self._choose_profiles(project.services))
        return project

    def find_folder(self, part: Part) -> str:
        """Returns the folder from which a relative path at `part` counts."""
        return self.folders.get(part.file, posixpath.dirname(part.file))

    def resolve(self, part: Part, path: str) -> str:
        """Returns the path of a file beside the one in which `part` stands."""
        return posixpath.normpath(posixpath.join(self.find_folder(part), path))

    def _read_variables(self, file: str) -> dict[str, str]:
        """Returns the variables for the values of a file: those of env files, and above them those of the command line."""
        variables: dict[str, str] = dict(self.request.defaults)
        names = self.request.env_files or (posixpath.join(posixpath.dirname(file), ".env"),)
        for name in names:
            data = self.read_file(name)
            if data is None and self.request.env_files:
                raise ComposeError("this file cannot be read; give the path of an env file", file=name, line=1)
            variables |= read_env(data or b"", name, {**variables, **self.request.variables})
        return {**variables, **self.request.variables}

    def _root(self, file: str, variables: dict[str, str], asker: Part | None = None) -> Part:
        """Returns the content of a compose file; `asker` is the value that names it."""
        if file not in self.roots:
            data = self.read_file(file)
            if data is None or len(self.roots) >= _MOST_FILES:
                text = f"the file {file} cannot be read; give it beside this one, or correct the path"
                raise asker.fail(text) if asker else ComposeError("this file cannot be read", file=file, line=1)
            self.variables[file] = variables
            self.roots[file] = read_parts(data, file, variables)
            self.roots[file].as_fields()
        return self.roots[file]

    def _add_file(self, project: Project, file: str, variables: dict[str, str], *, depth: int) -> None:
        root = self._root(file, variables)
        if depth > _DEEPEST:
            raise root.fail(
                f"files include each other deeper than {_DEEPEST} levels; remove an include that leads back"
            )
        if include := root.get("include"):
            for entry in include.as_items():
                self._include(project, entry, variables, depth)
        if name := root.get("name"):
            project.name = name.as_text()
            self.report.take(name, "name of the RobotApp")
        for kind in _NAMED:
            table = getattr(project, kind)
            part = root.get(kind)
            for key, value in (part.as_fields() if part else {}).items():
                entry = self._extend(value, key, ()) if kind == "services" else value
                table[key] = merge(table[key], entry) if key in table else entry
        if extension := root.get(EXTENSION):
            project.extension = merge(project.extension, extension) if project.extension else extension
        self._report_others(root)

    def _include(self, project: Project, entry: Part, variables: dict[str, str], depth: int) -> None:
        """Adds the files of one include."""
        path = entry.get("path") if entry.fields is not None else entry
        if path is None:
            raise entry.fail("an include needs the path of a file; write path: other/compose.yaml")
        scope = dict(variables)
        env_file = entry.get("env_file") if entry.fields is not None else None
        for item in env_file.as_items() if env_file else ():
            data = self.read_file(self.resolve(item, item.as_text()))
            scope = {**read_env(data or b"", item.as_text(), scope), **variables}
            self.report.take(item, "its variables are used in the included file")
        folder = entry.get("project_directory") if entry.fields is not None else None
        for item in path.as_items():
            file = self.resolve(item, item.as_text())
            base_folder = self.resolve(item, folder.as_text()) if folder else posixpath.dirname(file)
            env_data = self.read_file(posixpath.join(base_folder, ".env")) if env_file is None else None
            names = {**read_env(env_data or b"", posixpath.join(base_folder, ".env"), scope), **variables}
            self._root(file, names if env_data else scope, item)
            if folder:
                self.folders[file] = base_folder
                self.report.take(folder, f"relative paths of {file} count from here")
            self._add_file(project, file, names if env_data else scope, depth=depth + 1)
            self.report.take(item, f"included: {file}")
        for name, part in (entry.fields or {}).items():
            if name not in {"path", "env_file", "project_directory"}:
                self.report.omit(part, "include has no such field; write path, env_file or project_directory")

    def _extend(self, service: Part, name: str, trail: tuple[tuple[str, str], ...]) -> Part:
        """Returns the service with what it takes over from another one."""
        if (service.file, name) in trail or len(trail) > _DEEPEST:
            raise service.fail(f"{name} extends itself; remove the extends that leads back")
        fields = service.as_fields()
        extends = fields.get("extends")
        if extends is None or extends.is_empty:
            return service
        target = extends.get("service") if extends.fields is not None else extends
        if target is None:
            raise extends.fail("the service to extend is missing; write extends: {service: NAME}")
        file_part = extends.get("file") if extends.fields is not None else None
        file = self.resolve(file_part, file_part.as_text()) if file_part else service.file
        root = self._root(file, self.variables[service.file], file_part or extends)
        services = root.get("services")
        base = (services.fields or {}).get(target.as_text()) if services else None
        if base is None:
            raise extends.fail(f"{file} has no service {target.as_text()}; write the name of one of its services")
        base = self._extend(base, target.as_text(), (*trail, (service.file, name)))
        self.report.take(extends, f"the fields of {target.as_text()} in {file} are taken over")
        for key, part in (extends.fields or {}).items():
            if key not in {"service", "file"}:
                self.report.omit(part, "extends has no such field; write service and file")
        rest = replace(service, fields={key: part for key, part in fields.items() if key != "extends"})
        base_service = replace(base, fields={k: part for k, part in base.as_fields().items() if k != "profiles"})
        return merge(base_service, rest) if rest.fields else replace(base_service, file=service.file, line=service.line)

    def _choose_profiles(self, services: dict[str, Part]) -> dict[str, Part]:
        """Returns the services that run with the chosen profiles, and reports the others."""
        chosen: dict[str, Part] = {}
        for name, service in services.items():
            part = service.get("profiles")
            profiles = {item.as_text() for item in part.as_items()} if part else set()
            if not profiles or profiles & self.request.profiles or "*" in self.request.profiles:
                chosen[name] = service
                if part:
                    self.report.take(part, "this profile is chosen")
            else:
                names = ", ".join(sorted(profiles))
                self.report.omit(service, f"only part of the profile {names}; give --profile to import it")
        return chosen

    def _report_others(self, root: Part) -> None:
        """Reports the fields of a file that have no meaning in a cluster."""
        for name, part in root.as_fields().items():
            if name.startswith("x-") and name != EXTENSION:
                self.report.omit(part, "an extension; what aliases take from it is taken there")
            elif name == "version":
                self.report.omit(part, "compose ignores it as well")
            elif part.is_empty and name in _TOP:
                self.report.omit(part, "nothing is written here")
            elif name not in _TOP:
                self.report.omit(part, f"{name} is no field that an import acts on; correct the name, or leave it out")


def read_env(data: bytes, file: str, variables: Mapping[str, str]) -> dict[str, str]:
    """Returns the variables of an env file. Raises ComposeError."""
    try:
        lines = parse_env_file(data.decode("utf-8-sig"), variables)
        return {line.name: line.text for line in lines if line.text is not None}
    except UnicodeDecodeError as error:
        raise ComposeError("this is no UTF-8 text; save the file as UTF-8", file=file, line=1) from error
    except InterpolationError as error:
        raise ComposeError(str(error), file=file, line=1) from error
