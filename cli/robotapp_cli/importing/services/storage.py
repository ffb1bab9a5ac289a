"""Fields of a service about files: volumes, tmpfs, configs, secrets."""

import posixpath
import re
from dataclasses import dataclass
from typing import Final

from robotapp_cli.importing.files.interpolation import InterpolationError, interpolate
from robotapp_cli.importing.files.parts import Part
from robotapp_cli.importing.services.draft import (
    Context,
    Draft,
    Json,
    format_bytes,
    make_label,
    read_bytes,
    report_fields,
)
from robotapp_cli.lint.marks import MARK, PATH_MARK, VALUE_MARK

MOST_FILE: Final = 256 << 10
"""Bytes of a file that becomes a ConfigMap; all of one hold 1 MiB at most."""
_KEY: Final = re.compile(r"[^-._a-zA-Z0-9]+")
_PRIVATE: Final = re.compile(
    r"(?i)\.(pem|key|p12|pfx|jks|kdbx)$|secret|passw|credential|token|(^|/)id_|\.env$|htpasswd"
)
_HARMLESS: Final = frozenset({"rw", "z", "Z", "cached", "delegated", "consistent", "nocopy", "private", "rprivate", ""})
_PROPAGATION: Final = {
    "rshared": "Bidirectional",
    "shared": "Bidirectional",
    "rslave": "HostToContainer",
    "slave": "HostToContainer",
}
_SIZE: Final = "1Gi"


@dataclass(slots=True)
class Mount:
    """One entry of `volumes` in either form."""

    item: Part
    kind: str
    source: str
    target: str
    read_only: bool = False
    propagation: str = ""
    sub_path: str = ""
    size: str = ""


def take_volumes(draft: Draft, part: Part) -> None:
    """Takes named volumes, folders and files of the node, and memory."""
    for item in part.as_items():
        mount = _read_mount(draft, item)
        if item.unset and not mount.target.startswith("/"):
            mount.target = f"/{PATH_MARK}"
        if not mount.target.startswith("/"):
            raise item.fail(f"{mount.target[:60]!r} is no path in the container; write one that begins with /")
        if mount.kind == "tmpfs":
            _mount_memory(draft, item, mount.target, mount.size)
        elif mount.kind == "volume":
            _mount_named(draft, mount)
        elif mount.kind == "bind":
            _mount_bind(draft, mount)
        else:
            draft.report.omit(item, f"no volume of a pod is of type {mount.kind}; write it under template.spec.volumes")


def _read_mount(draft: Draft, item: Part) -> Mount:
    if item.fields is None:
        return _read_short(item)
    kind, source, target = (item.get(name) for name in ("type", "source", "target"))
    if target is None:
        raise item.fail("a volume needs a target; write target: /path/in/the/container")
    name = kind.as_text() if kind else "volume"
    mount = Mount(item, name, source.as_text() if source else "", target.as_text().rstrip("/") or "/")
    if read_only := item.get("read_only"):
        mount.read_only = read_only.as_bool()
    options = item.get(name)
    read_fields = {"type", "source", "target", "read_only"}
    if options is not None and options.fields is not None:
        read_fields.add(name)
        if size := options.get("size"):
            mount.size = format_bytes(read_bytes(size))
        if propagation := options.get("propagation"):
            mount.propagation = _PROPAGATION.get(propagation.as_text(), "")
        if sub_path := options.get("subpath"):
            mount.sub_path = sub_path.as_text()
        report_fields(
            draft,
            options,
            frozenset({"size", "propagation", "subpath"}),
            {
                "create_host_path": "a folder of the node is not made by this volume; make it, or write its type",
                "nocopy": "nothing is copied from the image into any volume",
                "selinux": "the container runtime labels volumes by itself",
                "mode": "memory of a pod has mode 0777",
            },
        )
    report_fields(draft, item, frozenset(read_fields), {"consistency": "docker ignores it as well"})
    return mount


def _read_short(item: Part) -> Mount:
    """Returns an entry such as ./config:/config:ro."""
    words = item.as_text().split(":")
    if len(words) == 1:
        return Mount(item, "volume", "", words[0])
    source, target = words[0], words[1].rstrip("/") or "/"
    kind = "bind" if source.startswith((".", "/", "~")) or (item.unset and (not source or MARK in source)) else "volume"
    mount = Mount(item, kind, source, target)
    for option in (words[2] if len(words) > 2 else "").split(","):
        mount.read_only = mount.read_only or option == "ro"
        mount.propagation = _PROPAGATION.get(option, mount.propagation)
    return mount


def _mount_memory(draft: Draft, item: Part, target: str, size: str) -> None:
    limit = {"sizeLimit": size} if size else {}
    volume = {"name": make_label(f"tmpfs-{target}"), "emptyDir": {"medium": "Memory", **limit}}
    draft.mount(volume, {"mountPath": target}, item)
    draft.report.take(item, f"memory at {target}; what is in it counts towards the memory limit")


def take_tmpfs(draft: Draft, part: Part) -> None:
    """Takes folders in memory, with their size."""
    for item in part.as_items():
        target, _, options = item.as_text().partition(":")
        words = dict(option.partition("=")[::2] for option in options.split(",") if option)
        size = words.pop("size", "")
        quantity = format_bytes(read_bytes(Part(item.file, item.line, item.path, size))) if size else ""
        if not target.startswith("/"):
            raise item.fail(f"{target[:60]!r} is no path in the container; write one that begins with /")
        _mount_memory(draft, item, target, quantity)
        if words:
            draft.report.change(item, f"memory of a pod has no option {', '.join(words)}")


def _mount_named(draft: Draft, mount: Mount) -> None:
    """Mounts a PersistentVolumeClaim, or an empty folder for a volume without a name."""
    place: Json = {"mountPath": mount.target}
    if mount.read_only:
        place["readOnly"] = True
    if mount.sub_path:
        place["subPath"] = mount.sub_path
    if not mount.source:
        draft.mount({"name": make_label(f"data-{mount.target}"), "emptyDir": {}}, place, mount.item)
        draft.report.change(mount.item, f"an empty folder at {mount.target} that ends with the pod")
        return
    part = draft.context.project.volumes.get(mount.source)
    if part is None:
        text = f"no volume is called {mount.source}; write it under volumes, or ./{mount.source} for a folder"
        raise mount.item.fail(text)
    device = _find_device(part)
    if device:
        draft.mount({"name": make_label(mount.source), "hostPath": {"path": device}}, place, mount.item)
        draft.report.change(mount.item, f"folder {device} of the node, which takes the right robotapps/hostpath")
        return
    claim = _name_claim(draft.context, mount.source, part)
    draft.mount({"name": make_label(mount.source), "persistentVolumeClaim": {"claimName": claim}}, place, mount.item)
    draft.report.take(mount.item, f"PersistentVolumeClaim {claim} at {mount.target}")


def _find_device(part: Part) -> str:
    """Returns the folder that a volume of the local driver binds, "" for all other volumes."""
    options = part.get("driver_opts") if part.fields is not None else None
    device = options.get("device") if options else None
    flags = options.get("o") if options else None
    binds = flags is not None and "bind" in flags.as_text().split(",")
    return device.as_text() if device and binds and device.as_text().startswith("/") else ""


def _name_claim(context: Context, name: str, part: Part) -> str:
    """Returns the name of the claim, and adds the claim to the output unless it exists outside."""
    external_part = part.get("external") if part.fields is not None else None
    name_part = part.get("name") if part.fields is not None else None
    is_external = external_part is not None and (external_part.fields is not None or external_part.as_bool())
    label = make_label(name_part.as_text() if name_part else name if is_external else f"{context.app}-{name}")
    if not is_external:
        context.objects[("PersistentVolumeClaim", label)] = {
            "apiVersion": "v1",
            "kind": "PersistentVolumeClaim",
            "metadata": {"name": label},
            "spec": {"accessModes": ["ReadWriteOnce"], "resources": {"requests": {"storage": _SIZE}}},
        }
    return label


def report_volumes(context: Context) -> None:
    """Reports the volumes of the file themselves."""
    for name, part in context.project.volumes.items():
        claim = make_label(f"{context.app}-{name}")
        fields = part.fields or {}
        if ("PersistentVolumeClaim", claim) in context.objects:
            text = (
                f"PersistentVolumeClaim {claim}: {_SIZE}, one node at a time, empty at first; write the size it needs"
            )
            context.report.change(part, text)
        elif "external" in fields:
            context.report.change(
                part, "external: the PersistentVolumeClaim of this name has to exist in the namespace"
            )
        else:
            context.report.omit(part, "no PersistentVolumeClaim is written for it; see the services that name it")
        for key, inner in fields.items():
            if key not in {"name", "external"}:
                binds = key == "driver_opts" and _find_device(part)
                text = (
                    "the folder is mounted from the node"
                    if binds
                    else "the StorageClass decides; write storageClassName"
                )
                context.report.omit(inner, text)


def _mount_bind(draft: Draft, mount: Mount) -> None:
    """Mounts a folder or file of the node; a small text file beside the compose file becomes a ConfigMap."""
    loader, item = draft.context.loader, mount.item
    home_folder = loader.variables.get(item.file, {}).get("HOME", "")
    if mount.source.startswith("~") and home_folder:
        mount.source = home_folder + mount.source[1:]
    relative = not mount.source.startswith(("/", "~"))
    path = loader.resolve(item, mount.source)
    if relative and not item.unset and (text := _read_small(draft, path)) is not None:
        key = _KEY.sub("_", posixpath.basename(path))
        name = f"{draft.context.app}-{posixpath.basename(path)}"
        _mount_config(draft, item, name, data={key: text}, target=mount.target)
        draft.report.change(item, f"a ConfigMap has the content of {path} at {mount.target}, read-only; edit it there")
        return
    if mount.source.startswith("~") or item.unset:
        home = item.unset[0] if item.unset else "the home folder"
        absolute = f"/{PATH_MARK}/{mount.source.replace(VALUE_MARK, '').lstrip('~/')}".rstrip("/")
        draft.report.mark(item, f"{home} has no value here; write the path on the node")
    else:
        absolute = _find_absolute(draft, path) if relative else posixpath.normpath(mount.source)
        text = f"{absolute} of the node at {mount.target}, which takes the right robotapps/hostpath"
        if relative:
            text += "; bring it to the nodes"
        elif absolute == "/dev" or absolute.startswith("/dev/"):
            text += "; a device file there opens with privileged: true"
        elif absolute.endswith("docker.sock"):
            text += "; nodes of a cluster have no docker"
        draft.report.change(item, text)
    place: Json = {"mountPath": mount.target}
    if mount.read_only:
        place["readOnly"] = True
    if mount.propagation:
        place["mountPropagation"] = mount.propagation
    draft.mount({"name": make_label(f"host-{absolute}", instead="host"), "hostPath": {"path": absolute}}, place, item)


def _find_absolute(draft: Draft, path: str) -> str:
    """Returns the path on the node of a path beside the first compose file."""
    request = draft.context.loader.request
    relative = posixpath.relpath(path or ".", posixpath.dirname(request.files[0]) or ".")
    return posixpath.normpath(posixpath.join(request.directory, relative))


def _read_small(draft: Draft, path: str) -> str | None:
    """Returns the text of a small file beside the compose file that has nothing secret in its name."""
    folder = posixpath.dirname(draft.context.loader.request.files[0]) or "."
    if posixpath.relpath(path or ".", folder).startswith("..") or _PRIVATE.search(path):
        return None
    data = draft.context.loader.read_file(path)
    if data is None or len(data) > MOST_FILE:
        return None
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        return None
    return text if text.replace("\n", "").replace("\t", "").replace("\r", "").isprintable() else None


def _mount_config(draft: Draft, item: Part, name: str, *, data: dict[str, str], target: str) -> None:
    """Adds a ConfigMap of one key and mounts it as one file."""
    objects = draft.context.objects
    (key,) = data
    label, number = make_label(name), 1
    while (other := objects.get(("ConfigMap", label))) is not None and other["data"] != data:
        number += 1
        label = make_label(f"{make_label(name, most=58)}-{number}")
    config: Json = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": label}, "data": data}
    objects[("ConfigMap", label)] = config
    volume = {"name": make_label(f"file-{key}"), "configMap": {"name": label}}
    draft.mount(volume, {"mountPath": target, "subPath": key, "readOnly": True}, item)


def take_configs(draft: Draft, part: Part) -> None:
    """Takes configs, each as one file of a ConfigMap."""
    for item in part.as_items():
        source, target = _read_grant(draft, item, "/")
        config = draft.context.project.configs.get(source)
        if config is None:
            raise item.fail(f"no config is called {source}; write it under configs")
        if (external_part := config.get("external")) is not None and external_part.as_bool():
            name_part = config.get("name")
            name = make_label(name_part.as_text() if name_part else source)
            volume = {"name": make_label(f"config-{source}"), "configMap": {"name": name}}
            draft.mount(volume, {"mountPath": target, "subPath": source, "readOnly": True}, item)
            draft.report.change(item, f"the ConfigMap {name} with the key {source} has to exist in the namespace")
            continue
        text = _read_config(draft, config)
        if text is None:
            draft.report.omit(item, "its file cannot be read as text; make a ConfigMap of it and mount that")
            continue
        key = _KEY.sub("_", source)
        _mount_config(draft, item, f"{draft.context.app}-{source}", data={key: text}, target=target)
        draft.report.take(item, f"a ConfigMap, as the file {target}")


def _read_grant(draft: Draft, item: Part, folder: str) -> tuple[str, str]:
    """Returns name and path of a config or secret of a service."""
    if item.fields is None:
        return item.as_text(), posixpath.join(folder, item.as_text())
    source, target = item.get("source"), item.get("target")
    if source is None:
        raise item.fail("the source is missing; write source: NAME")
    reasons = dict.fromkeys(("uid", "gid"), "files of a ConfigMap or Secret belong to root; fsGroup sets their group")
    reasons["mode"] = "files are readable by all; write defaultMode of the volume"
    report_fields(draft, item, frozenset({"source", "target"}), reasons)
    return source.as_text(), posixpath.join(folder, target.as_text() if target else source.as_text())


def _read_config(draft: Draft, config: Part) -> str | None:
    """Returns the content of a config: written here, a variable, or a small file."""
    if content := config.get("content"):
        return content.as_text()
    if variable := config.get("environment"):
        variables = draft.context.loader.variables.get(config.file, {})
        try:
            return interpolate(f"${{{variable.as_text()}}}", variables).value
        except InterpolationError as error:
            raise variable.fail(str(error)) from error
    file = config.get("file")
    return _read_small(draft, draft.context.loader.resolve(config, file.as_text())) if file else None


def take_secrets(draft: Draft, part: Part) -> None:
    """Names Secrets, whose content is never read."""
    for item in part.as_items():
        source, target = _read_grant(draft, item, "/run/secrets")
        secret = draft.context.project.secrets.get(source)
        if secret is None:
            raise item.fail(f"no secret is called {source}; write it under secrets")
        name = _name_secret(draft.context, source, secret)
        key = _KEY.sub("_", source)
        volume = {"name": make_label(f"secret-{source}"), "secret": {"secretName": name}}
        draft.mount(volume, {"mountPath": target, "subPath": key, "readOnly": True}, item)
        draft.report.change(item, f"make it first: kubectl create secret generic {name} --from-file={key}=FILE")


def _name_secret(context: Context, source: str, secret: Part) -> str:
    name_part, external_part = secret.get("name"), secret.get("external")
    return make_label(name_part.as_text() if name_part else source if external_part else f"{context.app}-{source}")


def report_grants(context: Context) -> None:
    """Reports the configs and secrets of the file themselves."""
    for part in context.project.configs.values():
        context.report.take(part, "see the services that use it")
        for key, inner in (part.fields or {}).items():
            if key not in {"file", "content", "environment", "external", "name"}:
                context.report.omit(inner, "a ConfigMap has no such field")
    for name, part in context.project.secrets.items():
        label = _name_secret(context, name, part)
        context.report.omit(part, f"secrets are never copied; the Secret {label} has to exist in the namespace")
