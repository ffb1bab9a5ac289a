"""The pods of an app that a command line selects."""

from dataclasses import dataclass
from typing import Final

from robotapp_api.model.names import Label
from robotapp_api.values.replicas import find_replicas
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.reading.fields import Json, label, meta, status
from robotapp_cli.reading.session import Session
from robotapp_client.api.resources import PODS, ROBOTAPPS

MOST_LISTED: Final = 10
"""Names that a message lists."""


@dataclass(frozen=True, slots=True)
class Selection:
    """An app, or one component or robot of it. `component` is also a replica that has an ordinal, or the role of a helper, such as discovery."""

    app: str
    component: str | None = None
    robot: str | None = None


@dataclass(frozen=True, slots=True)
class AppPod:
    """A pod of an app."""

    obj: Json

    @property
    def name(self) -> str:
        return str(meta(self.obj)["name"])

    @property
    def component(self) -> str:
        """The component's name; for a pod that the operator added its role, such as discovery or master."""
        return label(self.obj, Label.COMPONENT) or label(self.obj, Label.ROLE)

    @property
    def robot(self) -> str:
        """The instance's robot; "" for an app without robots."""
        return label(self.obj, Label.INSTANCE)

    @property
    def title(self) -> str:
        """Robot and component, for people."""
        return f"{self.robot}/{self.component}" if self.robot else self.component

    @property
    def is_running(self) -> bool:
        return status(self.obj).get("phase") == "Running" and not meta(self.obj).get("deletionTimestamp")


async def fetch_app(session: Session, selection: Selection) -> Json:
    """Returns the app. Raises CliError when it has no such component."""
    app = await session.client.get(ROBOTAPPS, selection.app, namespace=session.home)
    programs = (*app["spec"]["components"], *(app["spec"].get("recordings") or ()))
    names = [str(component["name"]) for component in programs]
    roles = {"discovery", "router", "master"}
    if selection.component and selection.component not in {*names, *find_replicas(app["spec"]["components"]), *roles}:
        shown_names = ", ".join(names[:MOST_LISTED])
        more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
        raise CliError(
            f"{selection.app} has no component {selection.component}; it has: {shown_names}{more}", code=Exit.NOT_FOUND
        )
    return app


def write_label_selector(app: Json, selection: Selection) -> str:
    """Returns the selector of the app's children, or of those of the selected robot."""
    labels = [f"{Label.APP_UID}={meta(app)['uid']}"]
    labels += [f"{Label.INSTANCE}={selection.robot}"] if selection.robot else []
    return ",".join(labels)


async def list_pods(session: Session, app: Json, selection: Selection) -> list[AppPod]:
    """Returns the selected pods by robot, component and name; helpers of the operator only where one is named."""
    labels = write_label_selector(app, selection)
    listing = await session.client.list(PODS, namespace=session.home, label_selector=labels)
    pods = [AppPod(obj) for obj in listing.items if is_selected(obj, app, selection)]
    return sorted(pods, key=lambda pod: (pod.robot, pod.component, pod.name))


def is_selected(obj: Json, app: Json, selection: Selection) -> bool:
    """Returns whether an object with the operator's labels belongs to the component, replica or role that was named, or to any component.

    A component may be named like a role, such as master; then it is the one that is meant.
    """
    component, role = label(obj, Label.COMPONENT), label(obj, Label.ROLE)
    if component or not selection.component:
        return bool(component) and selection.component in (None, component, label(obj, Label.REPLICA_OF))
    names = {part["name"] for part in app["spec"]["components"]}
    return role == selection.component and role not in names


def name_selection(selection: Selection) -> str:
    """Returns what was selected, for messages: `component driver of teleop on robot amr-07`."""
    text = f"component {selection.component} of {selection.app}" if selection.component else selection.app
    return f"{text} on robot {selection.robot}" if selection.robot else text


def explain_no_pods(session: Session, app: Json, selection: Selection) -> CliError:
    """Returns the failure of a selection without a pod, with the command that shows why."""
    if app["spec"].get("suspend"):
        return CliError(
            f"{selection.app} is suspended; start it with: {session.write_command('resume', selection.app)}",
            code=Exit.NOT_FOUND,
        )
    text = f"{name_selection(selection)} has no pod; {session.write_command('info', selection.app)} has the reason"
    return CliError(text, code=Exit.NOT_FOUND)
