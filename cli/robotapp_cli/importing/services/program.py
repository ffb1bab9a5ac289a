"""Fields of a service about its program: image, command, environment, user, terminal, signals."""

import math
import posixpath
import re
from dataclasses import replace
from typing import Final

from robotapp_cli.importing.files.interpolation import InterpolationError, parse_env_file
from robotapp_cli.importing.files.parts import Part
from robotapp_cli.importing.images import find_distro, find_distro_in, is_without_ros
from robotapp_cli.importing.services.draft import Draft, escape_references, read_seconds
from robotapp_cli.lint.marks import IMAGE_MARK, VALUE_MARK

_PULL: Final = {"always": "Always", "missing": "IfNotPresent", "if_not_present": "IfNotPresent", "never": "Never"}
_ENV_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")
_SECRET: Final = re.compile(r"(?i)passw|secret|token|api_?key|private_?key|credential")
_APP_WIDE: Final = frozenset({"ROS_DOMAIN_ID", "RMW_IMPLEMENTATION", "ROS_MASTER_URI", "ROS_DISTRO"})
_GRACE: Final = 10
"""Seconds that compose waits between the signal and the kill."""


def take_image(draft: Draft) -> None:
    """Sets the image of a component, whether the service names one or builds it."""
    service, report = draft.service, draft.report
    image, build = service.get("image"), service.get("build")
    service_name = str(service.path[-1])
    override = draft.context.loader.request.images.get(service_name, "")
    if build:
        _look_into_build(draft, build)
    text = image.as_text() if image else ""
    draft.distro = find_distro(override or text) or draft.distro
    draft.is_without_ros = is_without_ros(override or text)
    if override:
        draft.fields["image"] = override
        report.change(image or build or service, f"the image is {override}, as --image says")
    elif image and not image.unset and not re.search(r"\s", text) and text:
        draft.fields["image"] = text
        report.take(image, f"image {text}")
    else:
        draft.fields["image"] = IMAGE_MARK
        reason = f"{image.unset[0]} has no value" if image and image.unset else "no image is named"
        report.mark(image or build or service, f"{reason}; write the image, or give --image {service_name}=IMAGE")
    if build:
        text = "nothing is built in a cluster; build the image, push it to a registry the nodes reach, and name it"
        report.omit(build, text)


def _look_into_build(draft: Draft, build: Part) -> None:
    """Looks for the ROS distribution in arguments of the build and in its Dockerfile."""
    args = build.get("args") if build.fields is not None else None
    for name, value, has_value in args.list_pairs() if args else ():
        if name in {"ROS_DISTRO", "ROS_VERSION", "BASE_IMAGE", "FROM_IMAGE", "DISTRO"} and has_value:
            draft.distro = find_distro(f"ros:{value.as_text().rpartition('/')[2].replace(':', '-')}") or draft.distro
    context = (build.get("context") if build.fields is not None else build) or build
    folder = context.as_text() if context.fields is None else "."
    inline = build.get("dockerfile_inline") if build.fields is not None else None
    dockerfile = build.get("dockerfile") if build.fields is not None else None
    name = dockerfile.as_text() if dockerfile else "Dockerfile"
    if "://" in folder or draft.distro:
        return
    path = draft.context.loader.resolve(build, posixpath.join(folder, name))
    content = inline.as_text().encode() if inline else draft.context.loader.read_file(path)
    draft.distro = find_distro_in((content or b"").decode("utf-8", "replace"))


def take_command(draft: Draft, part: Part) -> None:
    """The command of compose is what Kubernetes calls args."""
    _take_words(draft, part, "args", "an empty command; the image's own counts")


def take_entrypoint(draft: Draft, part: Part) -> None:
    """The entrypoint of compose is what Kubernetes calls command."""
    reason = "an empty entrypoint clears the image's; write command with the program in its place"
    _take_words(draft, part, "command", reason)


def _take_words(draft: Draft, part: Part, field: str, reason: str) -> None:
    """Writes the words of a command line into a field of the container. `reason`: why an empty one is left out."""
    words = part.as_words()
    if words:
        draft.fields[field] = [escape_references(word) for word in words]
        report_words(draft, part, field)
    else:
        draft.report.omit(part, reason)
    draft.distro = draft.distro or find_distro_in(" ".join(words))


def report_words(draft: Draft, part: Part, field: str) -> None:
    """Reports a command, and the variables in it that have no value."""
    parts = [part, *(part.items or [])]
    required_names = [name for item in parts if VALUE_MARK in str(item.scalar) for name in item.unset]
    unset_names = [name for item in parts for name in item.unset]
    if required_names:
        draft.report.mark(part, f"{field}: {required_names[0]} is required and has no value; write it, or give --env")
    elif unset_names:
        draft.report.change(
            part, f"{field}: {', '.join(unset_names)} has no value, so nothing is in its place; give --env"
        )
    else:
        draft.report.take(part, field)


def take_env_file(draft: Draft, part: Part) -> None:
    """Takes the variables of env files, of which later ones replace earlier ones."""
    loader = draft.context.loader
    for item in part.as_items():
        path = item.get("path") if item.fields is not None else item
        if path is None:
            raise item.fail("an env file needs a path; write path: FILE")
        required_part = item.get("required") if item.fields is not None else None
        name = loader.resolve(item, path.as_text())
        data = loader.read_file(name)
        if data is None:
            is_optional = required_part is not None and not required_part.as_bool()
            reason = "it is optional and not there" if is_optional else "it cannot be read; put it there, or write env"
            draft.report.omit(item, f"variables of {name}: {reason}")
            continue
        try:
            for line in parse_env_file(data.decode("utf-8", "replace"), loader.variables.get(item.file, {})):
                if line.text is not None:
                    place = Part(name, line.line, (*item.path, line.name), line.text, unset=line.unset)
                    draft.env[line.name] = place
        except InterpolationError as error:
            raise item.fail(f"{name}: {error}") from error
        draft.report.take(item, f"the variables of {name} are in env")


def take_environment(draft: Draft, part: Part) -> None:
    """Takes variables; one without a value comes from --env, as it comes from the shell in compose."""
    variables = draft.context.loader.variables.get(part.file, {})
    for name, value, has_value in part.list_pairs():
        if has_value:
            draft.env[name] = value
        elif name in variables:
            draft.env[name] = replace(value, scalar=variables[name])
        else:
            draft.report.omit(value, f"{name} has no value here; give --env {name}=VALUE")


def finish_environment(draft: Draft) -> None:
    """Writes env, and sets the variables aside that are fields of the app."""
    entries = []
    for name, part in draft.env.items():
        text = part.as_text()
        if name in _APP_WIDE:
            draft.ros[name] = part
        elif not _ENV_NAME.fullmatch(name) or name.startswith("ROBOTAPP_"):
            draft.report.omit(part, f"{name!r} cannot be the name of a variable here; give it another one")
        else:
            entries.append({"name": name, "value": escape_references(text)})
            _report_variable(draft, name, part)
    if entries:
        draft.fields["env"] = entries


def _report_variable(draft: Draft, name: str, part: Part) -> None:
    text = part.as_text()
    peers = [peer for peer in draft.context.components if _names_host(text, peer) and peer != draft.service.path[-1]]
    if VALUE_MARK in text:
        draft.report.mark(part, f"env {name}: {part.unset[0]} is required and has no value; write it, or give --env")
    elif part.unset:
        draft.report.change(
            part, f"env {name}: {', '.join(part.unset)} has no value, so nothing is in its place; give --env"
        )
    elif _SECRET.search(name):
        draft.report.change(
            part, f"env {name}: the value stands in the app for all to read; a Secret and secretKeyRef hide it"
        )
    elif peers:
        text = f"env {name} names the service {peers[0]}; write the name of its Service (kubectl get services)"
        draft.report.change(part, text)
    else:
        draft.report.take(part, f"env {name}")


def _names_host(text: str, service: str) -> bool:
    return bool(re.search(rf"(?:^|://|@|[,;\s]){re.escape(service)}(?::\d+|/|$|[,;])", text)) and len(service) > 1


def take_user(draft: Draft, part: Part) -> None:
    """Takes numbers of user and group; names are in the image alone."""
    user, _, group = part.as_text().partition(":")
    for text, option, names in ((user, "runAsUser", {"root": "0"}), (group, "runAsGroup", {"root": "0"})):
        number = names.get(text, text)
        if number.isascii() and number.isdigit():
            draft.secure(option, int(number))
            draft.report.take(part, f"securityContext.{option}: {number}")
        elif text:
            draft.report.omit(part, f"{text!r} is a name, which only the image has; write its number")


def take_pull_policy(draft: Draft, part: Part) -> None:
    """Takes the policies that Kubernetes has as well."""
    policy = _PULL.get(part.as_text())
    if policy:
        draft.fields["imagePullPolicy"] = policy
        draft.report.take(part, f"imagePullPolicy: {policy}")
    else:
        draft.report.omit(part, "Kubernetes has always, missing and never; the default counts")


def take_platform(draft: Draft, part: Part) -> None:
    """Chooses nodes with the architecture of the image."""
    system, _, rest = part.as_text().partition("/")
    architecture = rest.partition("/")[0]
    if system != "linux" or not architecture:
        draft.report.omit(part, "only linux/ARCHITECTURE chooses nodes")
        return
    draft.pod.setdefault("nodeSelector", {})["kubernetes.io/arch"] = architecture
    draft.report.take(part, f"nodeSelector kubernetes.io/arch: {architecture}")


def take_restart(draft: Draft, part: Part) -> None:
    """Components always restart."""
    text = "no" if part.as_text() == "false" else part.as_text()
    if text in {"always", "unless-stopped"}:
        draft.report.take(part, "components are restarted whenever they end")
    elif text.startswith("on-failure"):
        draft.report.change(part, "components are restarted whenever they end, also with exit code 0")
    else:
        draft.report.omit(part, "components are restarted whenever they end; write job: {} for a program that ends")


def take_stop_signal(draft: Draft, part: Part) -> None:
    """Sends another signal than SIGTERM by a hook, which works in every cluster."""
    signal = part.as_text().upper().removeprefix("SIG")
    if signal in {"TERM", "15"}:
        draft.report.take(part, "SIGTERM is what Kubernetes sends")
        return
    if not signal.isascii() or not signal.isalnum():
        raise part.fail(f"{part.as_text()[:40]!r} is no signal; write for example SIGINT")
    period = draft.service.get("stop_grace_period")
    seconds = max(1, math.ceil(read_seconds(period))) if period else _GRACE
    draft.fields["lifecycle"] = {"preStop": {"exec": {"command": ["sh", "-c", f"kill -{signal} 1; sleep {seconds}"]}}}
    draft.pod["terminationGracePeriodSeconds"] = seconds + 5
    draft.report.change(
        part, f"a preStop hook sends SIG{signal} to process 1 and waits {seconds} s; the image needs sh"
    )


def take_stop_grace_period(draft: Draft, part: Part) -> None:
    """Sets the time between signal and kill, unless stop_signal has done so."""
    seconds = max(1, math.ceil(read_seconds(part)))
    draft.pod.setdefault("terminationGracePeriodSeconds", seconds)
    draft.report.take(part, f"terminationGracePeriodSeconds: {draft.pod['terminationGracePeriodSeconds']}")


def take_switch(draft: Draft, part: Part) -> None:
    """Takes stdin_open and tty."""
    field = {"stdin_open": "stdin", "tty": "tty"}[str(part.path[-1])]
    if part.as_bool():
        draft.fields[field] = True
    draft.report.take(part, f"{field}: {part.as_text()}")


def take_working_dir(draft: Draft, part: Part) -> None:
    """Takes the folder in which the program starts."""
    draft.fields["workingDir"] = part.as_text()
    draft.report.take(part, "workingDir")
