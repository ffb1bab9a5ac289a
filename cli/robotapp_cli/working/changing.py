"""`restart`, `suspend` and `resume`: changes that people would otherwise write as patches."""

from datetime import UTC, datetime

from robotapp_cli.output import print_line
from robotapp_cli.reading.fields import meta
from robotapp_cli.reading.pods import (
    Selection,
    explain_no_pods,
    fetch_app,
    is_selected,
    name_selection,
    write_label_selector,
)
from robotapp_cli.reading.session import Session
from robotapp_client.api.resources import DEPLOYMENTS, ROBOTAPPS
from robotapp_client.tools.rollout import restart_deployment


async def set_suspended(session: Session, name: str, *, suspend: bool) -> None:
    """Suspends an app or resumes it, and prints what happens now."""
    app = await session.client.get(ROBOTAPPS, name, namespace=session.home)
    if bool(app["spec"].get("suspend")) == suspend:
        print_line(f"{name} is {'already suspended' if suspend else 'not suspended'}; nothing was changed")
        return
    # The version makes it a compare-and-swap: an app that was made anew in between is another one.
    patch = {"metadata": {"resourceVersion": meta(app)["resourceVersion"]}, "spec": {"suspend": suspend}}
    await session.client.patch(ROBOTAPPS, name, patch, namespace=session.home)
    if suspend:
        print_line(f"{name} is suspended: its pods end, it keeps its domain and gives its devices back")
        print_line(f"Start it again: kubectl robotapp resume {name}")
    else:
        print_line(f"{name} is resumed; follow it: kubectl robotapp info {name} -w")


async def restart_components(session: Session, selection: Selection) -> None:
    """Replaces the pods of the selected components, as `kubectl rollout restart` does, and prints which."""
    app = await fetch_app(session, selection)
    labels = write_label_selector(app, selection)
    listing = await session.client.list(DEPLOYMENTS, namespace=session.home, label_selector=labels)
    deployments = [deployment for deployment in listing.items if is_selected(deployment, app, selection)]
    if not deployments or app["spec"].get("suspend"):
        raise explain_no_pods(app, selection)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    for deployment in deployments:
        await restart_deployment(session.client, deployment, at=now)
    count = len(deployments)
    selection_text = name_selection(selection)
    print_line(
        f"{selection_text}: pods of {count} Deployment{'' if count == 1 else 's'} are replaced; domain and devices stay"
    )
    print_line(f"Follow it: kubectl robotapp info {selection.app} -w")
