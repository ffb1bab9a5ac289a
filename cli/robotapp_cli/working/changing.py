"""`restart`, `suspend` and `resume`: changes that people would otherwise write as patches."""

from datetime import UTC, datetime

from robotapp_api.model.names import Condition
from robotapp_cli.failures import CliError
from robotapp_cli.output import print_line
from robotapp_cli.reading.fields import Json, condition, meta
from robotapp_cli.reading.pods import (
    Selection,
    explain_no_pods,
    fetch_app,
    is_selected,
    name_selection,
    write_label_selector,
)
from robotapp_cli.reading.runs import ENDED, JobRun, Run, has_ended, list_runs
from robotapp_cli.reading.session import Session
from robotapp_cli.working.runs import SCHEDULED_LATER, delete_job, refuse_scheduled
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
    if suspend and has_ended(app):
        print_line(f"{name} is suspended; it had ended before, so it has no pods, domain or devices")
        print_line(f"No job of it runs again until: {session.write_command('resume', name)}")
    elif suspend:
        print_line(f"{name} is suspended: its pods end, it keeps its domain and gives its devices back")
        print_line(f"Start it again: {session.write_command('resume', name)}")
    else:
        print_line(f"{name} is resumed; follow it: {session.write_command('info', name, '-w')}")


async def restart_components(session: Session, selection: Selection) -> None:
    """Replaces the pods of the selected components like `kubectl rollout restart`, runs jobs once more, and prints which.

    If other components are selected, too, jobs are left alone: to run one of them again it must be named.
    """
    app = await fetch_app(session, selection)
    labels = write_label_selector(app, selection)
    listing = await session.client.list(DEPLOYMENTS, namespace=session.home, label_selector=labels)
    deployments = [deployment for deployment in listing.items if is_selected(deployment, app, selection)]
    runs = await _list_selected_runs(session, app, selection)
    selected = [job for run in runs for job in run.jobs if is_selected(job.obj, app, selection)]
    if not deployments and selected and all(job.due for job in selected):
        raise refuse_scheduled(session, selection.app, selected)
    jobs = [job for run in runs for job in list_repeated(app, run, selection)] if not deployments else []
    if not (deployments or jobs) or app["spec"].get("suspend"):
        raise explain_no_pods(session, app, selection)
    accepted = condition(app, Condition.ACCEPTED)
    if jobs and accepted.get("status") == "False":
        raise CliError(f"no job of {selection.app} would be made, so none was deleted: {accepted.get('message', '')}")
    now = datetime.now(UTC).isoformat(timespec="seconds")
    for deployment in deployments:
        await restart_deployment(session.client, deployment, at=now)
    for job in jobs:
        await delete_job(session, job)
    text = name_selection(selection)
    if deployments:
        count = len(deployments)
        print_line(
            f"{text}: pods of {count} Deployment{'' if count == 1 else 's'} are replaced; domain and devices stay"
        )
        if any(not job.due for run in runs for job in run.jobs):
            command = session.write_command("restart", selection.app, "COMPONENT")
            print_line(f"Its jobs are left alone; to run one again: {command}")
        print_line(f"Follow it: {session.write_command('info', selection.app, '-w')}")
    else:
        names = ", ".join(sorted({job.component for job in jobs}))
        print_line(f"{text}: {len(jobs)} job{' runs' if len(jobs) == 1 else 's run'} once more ({names})")
        if any(job.due for job in selected):
            print_line(SCHEDULED_LATER)
        print_line(f"Follow it: {session.write_command('runs', selection.app)}")


async def _list_selected_runs(session: Session, app: Json, selection: Selection) -> list[Run]:
    """Returns the selected runs of an app with jobs, [] for another app."""
    if not any(component.get("job") is not None for component in app["spec"]["components"]):
        return []
    return [run for run in await list_runs(session, app) if selection.robot in (None, run.instance.name)]


def list_repeated(app: Json, run: Run, selection: Selection) -> list[JobRun]:
    """Returns the Jobs of a run that are to be deleted so that the selected ones run once more, without runs of schedules.

    A run that has ended would stay so by its other jobs. Therefore the failed ones are deleted, too, and with
    `completion` all of them, because some of them decide, or the time since the first one.
    """
    jobs = [job for job in run.jobs if not job.due]
    selected = [job for job in jobs if is_selected(job.obj, app, selection)]
    if not selected or run.phase not in ENDED:
        return selected
    if app["spec"].get("completion") is not None:
        return jobs
    return [job for job in jobs if job in selected or job in run.failed_jobs]
