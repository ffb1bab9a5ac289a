"""`render`: what a RobotApp has become, or, with -f, what the API server would store.

The operator's plan is not part of this program, and a copy of it would drift. So a RobotApp in the cluster is shown by
the children the operator made of it, without what the server and the controllers added; a file is sent as a server-side
dry run, which fills in the defaults and applies every rule, and nothing is stored.
"""

import sys
from pathlib import Path
from typing import Final

import yaml

from robotapp_api.model.names import API_VERSION, Label
from robotapp_api.values.arguments import is_name, not_a_name
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.output import Output, write_structured
from robotapp_cli.reading.fields import Json, meta
from robotapp_cli.reading.files import documents
from robotapp_cli.reading.session import Session
from robotapp_client.api.resources import CONFIGMAPS, DEPLOYMENTS, ROBOTAPPS, SERVICES

_CHILDREN: Final = (CONFIGMAPS, SERVICES, DEPLOYMENTS)
_SERVER_METADATA: Final = ("managedFields", "uid", "resourceVersion", "generation", "creationTimestamp", "selfLink")
_CONTROLLER_ANNOTATIONS: Final = ("deployment.kubernetes.io/revision",)
_MAX_BYTES: Final = 1024 * 1024


async def show_children(session: Session, name: str) -> None:
    """The ConfigMaps, Services and Deployments the operator made of the RobotApp."""
    app = await session.client.get(ROBOTAPPS, name, namespace=session.home)
    uid = meta(app)["uid"]
    found: list[Json] = []
    for resource in _CHILDREN:
        listing = await session.client.list(resource, namespace=session.home, label_selector=f"{Label.APP_UID}={uid}")
        owned = [child for child in listing.items if _owned(child, uid)]
        found += [{"apiVersion": resource.api_version, "kind": resource.kind, **cleaned(child)} for child in owned]
    if not found:
        sys.stderr.write(f"{name} has no children yet: {session.write_command('info', name)} says why\n")
    _write(found, session.options.output)


def _owned(child: Json, uid: str) -> bool:
    return any(owner.get("uid") == uid for owner in meta(child).get("ownerReferences") or [])


def cleaned(obj: Json) -> Json:
    """Without status and the metadata that the server and other controllers wrote."""
    metadata = {key: value for key, value in meta(obj).items() if key not in _SERVER_METADATA}
    annotations = {
        key: value for key, value in metadata.pop("annotations", {}).items() if key not in _CONTROLLER_ANNOTATIONS
    }
    if annotations:
        metadata["annotations"] = annotations
    rest = {key: value for key, value in obj.items() if key not in ("metadata", "status", "apiVersion", "kind")}
    return {"metadata": metadata, **rest}


async def show_file(session: Session, path: Path) -> None:
    """The RobotApps of a file as the API server would store them."""
    apps = _read(path)
    stored = []
    for app in apps:
        namespace = session.options.namespace or meta(app).get("namespace") or session.home
        app["metadata"]["namespace"] = namespace
        query = "dryRun=All&fieldValidation=Strict&fieldManager=kubectl-robotapp&force=true"
        path_of_app = f"{ROBOTAPPS.path(namespace, meta(app)['name'])}?{query}"
        body = yaml.safe_dump(app).encode()
        answer = await session.client.request("PATCH", path_of_app, body, "application/apply-patch+yaml")
        stored.append({"apiVersion": API_VERSION, "kind": "RobotApp", **cleaned(yaml.safe_load(answer.body))})
    _write(stored, session.options.output)


def _read(path: Path) -> list[Json]:
    apps = [
        item
        for item in documents(path, most_bytes=_MAX_BYTES)
        if isinstance(item, dict) and item.get("kind") == "RobotApp" and isinstance(item.get("metadata"), dict)
    ]
    if not apps or not all(meta(app).get("name") for app in apps):
        raise CliError(f"{path} holds no RobotApp with a name", code=Exit.USAGE)
    for app in apps:
        for field in ("name", "namespace"):
            text = meta(app).get(field)
            if text is not None and not is_name(str(text)):
                raise CliError(f"{path}: metadata.{field}: {not_a_name(str(text))}", code=Exit.USAGE)
    return apps


def _write(objects: list[Json], output: Output) -> None:
    if output is Output.JSON:
        write_structured({"apiVersion": "v1", "kind": "List", "items": objects}, output)
    else:
        sys.stdout.write(yaml.safe_dump_all(objects, sort_keys=False, allow_unicode=True, width=120))
