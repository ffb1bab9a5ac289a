"""`runs`: the runs of an app whose components end, what each was run with, and failed ones once more."""

from collections.abc import Sequence
from typing import Annotated, Final

import typer

from robotapp_api.model.names import Condition, Phase
from robotapp_cli.arguments import Context, Kubeconfig, Name, Namespace, OutputFormat
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.output import Column, Output, print_line, print_table, write_structured
from robotapp_cli.reading import session as sessions
from robotapp_cli.reading.fields import Json, condition, elapsed, meta
from robotapp_cli.reading.runs import JobRun, Run, describe_provenance, list_runs, read_kubelets
from robotapp_cli.reading.session import Options, Session
from robotapp_client import Conflict, NotFound
from robotapp_client.api.resources import JOBS, ROBOTAPPS

BACKGROUND: Final = "Background"
FOREGROUND: Final = "Foreground"
SCHEDULED_LATER: Final = "Those with schedule run when they are due"


def add_runs_command(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command(
        "runs",
        epilog="Examples: kubectl robotapp runs sweep; kubectl robotapp runs sweep --failed; kubectl robotapp runs sweep -o json",
    )(runs_command)


def runs_command(
    name: Name,
    *,
    failed: Annotated[bool, typer.Option("--failed", help="Run those that have failed once more.")] = False,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
    output: OutputFormat = Output.TABLE,
) -> None:
    """Show the runs of an app with job: values, duration, exit codes; -o json has images, nodes and versions of each."""
    options = Options(namespace=namespace, context=context, kubeconfig=kubeconfig, output=output)
    sessions.run(options, lambda session: repeat_failed(session, name) if failed else show_runs(session, name))


async def show_runs(session: Session, name: str) -> None:
    """Prints the runs as a table, or their provenance."""
    app = await fetch_app_with_jobs(session, name)
    runs = await list_runs(session, app)
    if session.options.output.structured:
        kubelets = await read_kubelets(session, runs)
        write_structured([describe_provenance(app, run, kubelets) for run in runs], session.options.output)
        return
    print_table(
        ["RUN", Column("VALUES", wraps=True), "PHASE", "DURATION", "EXIT"],
        [[*list_cells(run, list_parameters(app))] for run in runs],
    )
    print_refusal(app)


def print_refusal(app: Json) -> None:
    """Prints why no job of the app is made, if its spec is not accepted."""
    accepted = condition(app, Condition.ACCEPTED)
    if accepted.get("status") == "False":
        print_line(f"No job is made: {accepted.get('message', '')}", style="yellow")


def list_parameters(app: Json) -> Sequence[str]:
    """Returns the names of the parameters of the app's matrix in their order; an object has its values in that of the alphabet."""
    return [parameter["name"] for parameter in (app["spec"].get("matrix") or {}).get("parameters") or ()]


def list_cells(run: Run, parameters: Sequence[str]) -> Sequence[str]:
    """Returns the cells of a run's row. parameters: in the order in which they are shown."""
    names = dict.fromkeys([*parameters, *run.values])
    values = " ".join(f"{name}={run.values[name]}" for name in names if name in run.values)
    seconds = run.seconds()
    codes = run.exit_codes
    exit_text = ", ".join(
        f"{component} {code}" if len(run.jobs) > 1 else str(code) for component, code in codes.items()
    )
    phase = f"{run.phase}, restarts: {run.restarts}" if run.restarts else run.phase
    if (last_job := run.last_scheduled_job) is not None:
        phase += f", last run: {f'{last_job.component} ' if len(run.jobs) > 1 else ''}{last_job.result}"
    return run.instance.name or "-", values, phase, "" if seconds is None else elapsed(seconds), exit_text


async def fetch_app_with_jobs(session: Session, name: str) -> Json:
    """Returns the app. Raises CliError when no component of it ends."""
    app = await session.client.get(ROBOTAPPS, name, namespace=session.home)
    if not any(component.get("job") is not None for component in app["spec"]["components"]):
        raise CliError(
            f"{name} has no component with job, so its programs run on; {session.write_command('info', name)} shows them",
            code=Exit.NOT_FOUND,
        )
    return app


async def repeat_failed(session: Session, name: str) -> None:
    """Deletes the failed Jobs of runs that have not completed, which the operator makes anew, and prints which.

    Where the jobs of a failed run have a deadline together, it deletes all of them: the time counts from the first one, and would be over.
    A job with schedule runs when it is due. Raises CliError when only such jobs have failed.
    """
    app = await fetch_app_with_jobs(session, name)
    runs = await list_runs(session, app)
    if app["spec"].get("suspend"):
        raise CliError(f"{name} is suspended; start it with: {session.write_command('resume', name)}")
    # A run whose other components wait for a failed job has not ended, and never will.
    has_deadline = bool((app["spec"].get("completion") or {}).get("deadline"))
    candidates = [
        (run, job)
        for run in runs
        if run.phase != Phase.COMPLETED
        for job in (run.jobs if has_deadline and run.phase == Phase.FAILED else run.failed_jobs)
    ]
    jobs = [(run, job) for run, job in candidates if not job.due]
    scheduled_jobs = [job for _, job in candidates if job.due]
    if scheduled_jobs and not jobs:
        raise refuse_scheduled(session, name, scheduled_jobs)
    if not jobs:
        print_line(f"{name} has no failed job; nothing was changed")
        print_refusal(app)
        return
    for run, job in jobs:
        await delete_job(session, job)
        print_line(f"{run.instance.name or name}: {job.component} runs once more")
    if scheduled_jobs:
        print_line(SCHEDULED_LATER)
    print_line(f"Follow it: {session.write_command('runs', name)}")


def refuse_scheduled(session: Session, app: str, jobs: Sequence[JobRun]) -> CliError:
    """Returns the refusal to run jobs again that have a schedule, with the command that shows when they are due."""
    names = sorted({job.component for job in jobs})
    verb = "runs when it is" if len(names) == 1 else "run when they are"
    return CliError(f"{', '.join(names)} {verb} due, not before; {session.write_command('info', app)} has the time")


async def delete_job(session: Session, job: JobRun) -> None:
    """Deletes this Job with its pods, and no other one of its name. One that runs is gone after its last pod: its successor comes then."""
    try:
        await session.client.delete(
            JOBS,
            str(meta(job.obj)["name"]),
            namespace=session.home,
            uid=str(meta(job.obj)["uid"]),
            propagation=BACKGROUND if job.ended else FOREGROUND,
        )
    except (NotFound, Conflict):  # somebody else has deleted it meanwhile
        return
