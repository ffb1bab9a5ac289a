"""All services to one RobotApp: its ROS distribution, domain, middleware and master, and the objects beside it."""

import posixpath
import re
from dataclasses import dataclass
from typing import Final

from robotapp_api.checks.middleware import resolve_mode
from robotapp_api.model.distros import DISTROS, NO_DISTRO, WITHOUT_ROS
from robotapp_api.model.names import API_VERSION
from robotapp_cli.importing.files.parts import Part
from robotapp_cli.importing.files.project import ImportRequest, Loader, ReadFile
from robotapp_cli.importing.report import ComposeError, Report
from robotapp_cli.importing.services.component import draft_component, report_silent
from robotapp_cli.importing.services.draft import Context, Draft, Json, make_label, make_unique
from robotapp_cli.importing.services.extension import extend_component, extend_spec
from robotapp_cli.importing.services.operation import list_ending_services, make_job
from robotapp_cli.importing.services.storage import report_grants, report_volumes
from robotapp_cli.lint.findings import shown
from robotapp_cli.lint.marks import DISTRO_MARK

_MOST_COMPONENTS: Final = 64
_MOST_NAME: Final = 40
_SAFE_DOMAINS: Final = (range(1, 102), range(215, 233))
_CORE: Final = re.compile(r"(^|[\s/])roscore(\s|$)")
_LOCAL: Final = re.compile(r"http://(localhost|127\.0\.0\.1|0\.0\.0\.0)(:\d+)?/?")


@dataclass(frozen=True, slots=True)
class ImportResult:
    """The objects to write, the RobotApp last, and the report."""

    objects: list[Json]
    report: Report


def import_compose(request: ImportRequest, read_file: ReadFile) -> ImportResult:
    """Returns the RobotApp that compose files stand for. Raises ComposeError."""
    report = Report()
    loader = Loader(read_file, request, report)
    project = loader.load()
    first = request.files[0]
    if not project.services:
        profiles = " or give --profile" if any("profile" in line.message for line in report.lines) else ""
        raise ComposeError(f"no service is left to import; write services{profiles}", file=first, line=1)
    if len(project.services) > _MOST_COMPONENTS:
        text = f"{len(project.services)} services; an app has {_MOST_COMPONENTS} components at most, so split the file"
        raise ComposeError(text, file=first, line=1)
    folder = posixpath.basename(request.directory.rstrip("/"))
    app = make_label(request.name or project.name or folder, most=_MOST_NAME)
    context = Context(app, project, loader, report)
    _name_components(context)
    drafts = [draft_component(context, name, project.services[name]) for name in context.components]
    ending = list_ending_services(context)
    for name, draft in zip(context.components, drafts, strict=True):
        if name in ending:
            make_job(draft)
    spec = _decide_ros(context, drafts)
    _drop_host_names(context, drafts, spec)
    spec["components"] = [extend_component(draft) for draft in drafts]
    spec = extend_spec(context, spec)
    for draft in drafts:
        report_silent(draft)
    report_volumes(context)
    report_grants(context)
    for part in project.networks.values():
        report.omit(part, "all pods of a cluster reach each other, and domains keep apps apart")
    robotapp = {"apiVersion": API_VERSION, "kind": "RobotApp", "metadata": {"name": app}, "spec": spec}
    beside = [context.objects[key] for key in sorted(context.objects)]
    return ImportResult([*beside, robotapp], report)


def _drop_host_names(context: Context, drafts: list[Draft], spec: Json) -> None:
    """Removes the host names of pods that the others find under the operator's name for them."""
    distro = DISTROS.get(spec["ros"]["distro"])
    rmw = spec.get("ros2", {}).get("rmw") or (distro.rmw if distro else "")
    if resolve_mode("Auto", rmw) != "Peers":
        return
    for draft in drafts:
        part = draft.service.get("hostname")
        if part is not None and draft.pod.pop("hostname", None):
            context.report.lines = [line for line in context.report.lines if line.path != shown(part.path)]
            context.report.omit(part, f"with {rmw} a pod's host name is that under which the others find it")


def _name_components(context: Context) -> None:
    """Gives every service the name of a component; the master of ROS 1 is not one, because the operator runs it."""
    for name, service in context.project.services.items():
        command, entrypoint = service.get("command"), service.get("entrypoint")
        words = " ".join(word for part in (entrypoint, command) if part for word in part.as_words())
        if _CORE.search(words) and len(context.project.services) > 1 and "roslaunch" not in words:
            context.report.omit(service, "the operator runs a master for each instance (spec.ros1.master: Managed)")
            for part in (service.fields or {}).values():
                context.report.omit(part, "part of the master's service")
            continue
        label = make_unique(make_label(name, instead="component"), list(context.components.values()))
        context.components[name] = label
        if label != name:
            context.report.change(service, f"the component is called {label}: a name has small letters, digits and -")


def _decide_ros(context: Context, drafts: list[Draft]) -> Json:
    """Returns ros, ros2 and ros1 of the app."""
    with_ros = [draft for draft in drafts if not draft.is_without_ros]
    distro = _decide_distro(context, with_ros)
    for draft in drafts:
        if draft.is_without_ros and distro != NO_DISTRO:
            draft.fields["ros"] = WITHOUT_ROS
            context.report.change(draft.service, "ros: None, because the image is known to have no ROS in it")
        elif not draft.is_without_ros and not draft.distro and distro not in (NO_DISTRO, DISTRO_MARK):
            context.report.change(draft.service, "taken for a ROS program; write ros: None if it is none")
    without_ros = drafts if distro == NO_DISTRO else [draft for draft in drafts if draft.is_without_ros]
    for part in (part for draft in without_ros for part in draft.ros.values()):
        context.report.omit(part, "a program without ROS has no use for it")
    spec: Json = {"ros": {"distro": distro}}
    if distro == NO_DISTRO:
        return spec
    version = DISTROS[distro].version if distro in DISTROS else _guess_version(with_ros)
    settings = [("ROS_DOMAIN_ID", _decide_domain), ("RMW_IMPLEMENTATION", _decide_rmw)]
    ros2: Json = {}
    for name, decide in settings:
        parts = _find_all(with_ros, name)
        if version == 2:
            ros2 |= decide(context, parts)
        else:
            for part in parts:
                context.report.omit(part, f"{name} is of ROS 2")
    if ros2:
        spec["ros2"] = ros2
    for part in _find_all(with_ros, "ROS_DISTRO"):
        context.report.take(part, "spec.ros.distro")
    if ros1 := _decide_master(context, _find_all(with_ros, "ROS_MASTER_URI"), version):
        spec["ros1"] = ros1
    return spec


def _find_all(drafts: list[Draft], name: str) -> list[Part]:
    return [draft.ros[name] for draft in drafts if name in draft.ros]


def _guess_version(drafts: list[Draft]) -> int:
    """Returns the version of ROS where the distribution is still to be chosen."""
    has_master = any("ROS_MASTER_URI" in draft.ros for draft in drafts)
    return 1 if has_master and not any("ROS_DOMAIN_ID" in draft.ros for draft in drafts) else 2


def _decide_distro(context: Context, drafts: list[Draft]) -> str:
    """Returns the distribution of all components, or the mark where their images do not agree or do not show it."""
    if context.loader.request.distro:
        return context.loader.request.distro
    if not drafts:
        return NO_DISTRO
    services = next(iter(context.project.services.values()))
    for draft in drafts:
        part = draft.ros.get("ROS_DISTRO")
        if part and part.as_text() in DISTROS:
            draft.distro = part.as_text()
    names = sorted({draft.distro for draft in drafts if draft.distro})
    if len(names) == 1:
        return names[0]
    if names:
        text = (
            f"the images are of {' and '.join(names)}, and an app has one distribution; choose one, or split the file"
        )
    else:
        text = "no image names its ROS distribution; write spec.ros.distro, or give --distro"
    first = Part(services.file, services.line, ("services",))
    context.report.mark(first, text)
    return DISTRO_MARK


def _decide_domain(context: Context, parts: list[Part]) -> Json:
    """Returns the domain where all services have one that may be claimed."""
    texts = {part.as_text() for part in parts}
    text = next(iter(texts)) if len(texts) == 1 else ""
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 4 else 0
    if any(number in domains for domains in _SAFE_DOMAINS):
        for part in parts:
            context.report.take(part, f"spec.ros2.domain: {number}; without it each instance gets a free one")
        return {"domain": number}
    for part in parts:
        reason = "the services have several" if len(texts) > 1 else f"{text or 'none'} is not one of 1-101 and 215-232"
        context.report.omit(part, f"{reason}; each instance gets a free domain, or write spec.ros2.domain")
    return {}


def _decide_rmw(context: Context, parts: list[Part]) -> Json:
    """Returns the middleware where all services that name one agree."""
    texts = {text for part in parts if (text := part.as_text())}
    if len(texts) != 1:
        for part in parts:
            reason = "the services have several, and an app has one" if texts else "it has no value"
            context.report.omit(part, f"{reason}; write spec.ros2.rmw")
        return {}
    for part in parts:
        context.report.take(part, "spec.ros2.rmw, for all components")
    return {"rmw": texts.pop()}


def _decide_master(context: Context, parts: list[Part], version: int) -> Json:
    """Returns the master of ROS 1: one of another machine, or nothing for the operator's own."""
    ros1: Json = {}
    for part in parts:
        uri = part.as_text()
        host = re.sub(r"^http://|:\d+/?$|/$", "", uri)
        if version != 1:
            context.report.omit(part, "a master is of ROS 1, and this is an app of ROS 2")
        elif part.unset or not uri or _LOCAL.fullmatch(uri) or host in context.project.services:
            context.report.change(part, "the operator runs a master for each instance and sets the variable")
        elif ros1 and ros1["uri"] != uri:
            context.report.omit(part, f"an app has one master; {ros1['uri']} is written")
        else:
            ros1 = {"master": "External", "uri": uri}
            context.report.take(part, "spec.ros1.uri, with master: External")
    return ros1
