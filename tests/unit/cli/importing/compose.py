"""Compose files as Python values, and their import."""

from typing import Any

import yaml

from robotapp_cli.importing.app import ImportResult, import_compose
from robotapp_cli.importing.files.project import ImportRequest
from robotapp_cli.importing.report import Verdict

Json = dict[str, Any]


def import_files(files: dict[str, str], *, names: list[str] | None = None, **request: Any) -> ImportResult:
    """Imports the first of these files, or those of `names`; the others lie beside it."""
    given = {"files": names or [next(iter(files))], "directory": "/srv/robot", **request}
    texts = {name: text.encode() for name, text in files.items()}
    return import_compose(ImportRequest(**given), texts.get)


def import_services(
    services: Json, *, top: Json | None = None, files: dict[str, str] | None = None, **request: Any
) -> ImportResult:
    """Imports a compose file with these services."""
    text = yaml.safe_dump({"services": services, **(top or {})}, sort_keys=False)
    return import_files({"compose.yaml": text, **(files or {})}, **request)


def import_one(service: Json, **more: Any) -> ImportResult:
    """Imports a service `driver` of an image with ROS."""
    return import_services({"driver": {"image": "ros:jazzy", **service}}, **more)


def get_spec(result: ImportResult) -> Json:
    return dict(result.objects[-1]["spec"])


def get_component(result: ImportResult, name: str = "driver") -> Json:
    return next(dict(component) for component in get_spec(result)["components"] if component["name"] == name)


def get_pod(result: ImportResult, name: str = "driver") -> Json:
    return dict(get_component(result, name)["template"]["spec"])


def find_lines(result: ImportResult, path: str) -> list[tuple[Verdict, str]]:
    return [(line.verdict, line.message) for line in result.report.lines if line.path == path]


def get_verdict(result: ImportResult, path: str) -> Verdict:
    (line,) = find_lines(result, path)
    return line[0]
