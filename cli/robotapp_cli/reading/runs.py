"""The runs of an app whose components end: one for each instance, with what it was run with and how it ended.

A run is read from its RobotAppInstance, its Jobs and their pods; of a pod that is gone, what only it had is left out.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from robotapp_api.model.names import Annotation, Condition, Label, Phase
from robotapp_api.values.quantities.times import read_moment
from robotapp_claims.rules.completion.endings import read_number
from robotapp_cli.reading.fields import Json, condition, label, meta, status
from robotapp_cli.reading.instances import Instance, instances_of
from robotapp_cli.reading.session import Session
from robotapp_client import Forbidden, NotFound
from robotapp_client.api.resources import JOBS, NODES, PODS

SEED: Final = "seed"
"""The parameter of a matrix whose value is the run's seed."""
_FINAL: Final = ("Complete", "Failed")
ENDED: Final = frozenset({Phase.COMPLETED, Phase.FAILED})


@dataclass(frozen=True, slots=True)
class JobRun:
    """One component of a run: its Job, and the pods that it had, the latest last."""

    obj: Json
    pods: Sequence[Json]

    @property
    def component(self) -> str:
        return label(self.obj, Label.COMPONENT)

    @property
    def due(self) -> str:
        """Returns the due time of its schedule for which it was made; "" for a job that runs once."""
        return str((meta(self.obj).get("annotations") or {}).get(Annotation.DUE_AT) or "")

    @property
    def is_mark(self) -> bool:
        """Returns whether it only marks since when a schedule counts, and never runs."""
        return not self.due and Annotation.SETTLED_AT in (meta(self.obj).get("annotations") or {})

    @property
    def result(self) -> str:
        """Complete, Failed, Suspended or Running."""
        for kind in ("Complete", "Failed", "Suspended"):
            if condition(self.obj, kind).get("status") == "True":
                return kind
        return "Running"

    @property
    def started(self) -> str:
        return str(status(self.obj).get("startTime") or "")

    @property
    def began(self) -> str:
        """Returns the beginning of the first attempt that was recorded at a restart (completion.maxRestarts), "" without one."""
        return str((meta(self.obj).get("annotations") or {}).get(Annotation.BEGAN) or "")

    @property
    def ended(self) -> str:
        """When it completed or failed, "" before that."""
        time = status(self.obj).get("completionTime") or condition(self.obj, "Failed").get("lastTransitionTime")
        return str(time or "") if self.result in _FINAL else ""

    @property
    def exit_code(self) -> int | None:
        """Exit code of the component's program in its latest pod; None while it runs, and where no pod is left."""
        if self.result not in _FINAL:
            return None
        codes = (_exit_code(pod, self.component) for pod in reversed(self.pods))
        return next((code for code in codes if code is not None), None)

    @property
    def reason(self) -> str:
        """Why the Job failed, in the words of Kubernetes."""
        failed = condition(self.obj, "Failed")
        return f"{failed.get('reason', '')}: {failed.get('message', '')}" if failed.get("status") == "True" else ""


@dataclass(frozen=True, slots=True)
class Run:
    """One instance of an app whose components end."""

    instance: Instance
    jobs: Sequence[JobRun]

    @property
    def values(self) -> dict[str, str]:
        """Values of the matrix; {} for an app without one."""
        return dict((self.instance.obj.get("spec") or {}).get("matrix") or {})

    @property
    def phase(self) -> str:
        return str(self.instance.observed.get("phase") or Phase.PENDING)

    @property
    def last_scheduled_job(self) -> JobRun | None:
        """Returns the Job that began last, where all jobs have a schedule; None for other runs."""
        if not all(job.due for job in self.jobs):
            return None
        return max(self.jobs, key=lambda job: job.started, default=None)

    @property
    def timed_jobs(self) -> Sequence[JobRun]:
        """Returns the jobs whose times are those of the run: a schedule goes on, so only its last run has a beginning and an end."""
        last_job = self.last_scheduled_job
        return [job for job in self.jobs if not job.due] if last_job is None else [last_job]

    @property
    def started(self) -> str:
        """Returns when its first Job began, in the first of its attempts; "" before that."""
        if self.last_scheduled_job is not None:
            return self.last_scheduled_job.started
        restarts = self.instance.observed.get("restarts") or {}
        texts = [job.started for job in self.timed_jobs] + [job.began for job in self.timed_jobs]
        times = [text for text in (*texts, str(restarts.get("began") or "")) if read_moment(text) is not None]
        return min(times, default="")

    @property
    def ended(self) -> str:
        """Returns when its last Job ended, "" while it has not ended as a whole."""
        has_ended = self.phase in ENDED or self.last_scheduled_job is not None
        return max((job.ended for job in self.timed_jobs), default="") if has_ended else ""

    @property
    def restarts(self) -> int:
        """Returns how often it was started again because a job had failed (completion.maxRestarts)."""
        return int((self.instance.observed.get("restarts") or {}).get("count") or 0)

    @property
    def exit_codes(self) -> dict[str, int]:
        """Exit codes by component, without those that have none yet."""
        return {job.component: code for job in self.jobs if (code := job.exit_code) is not None}

    @property
    def failed_jobs(self) -> list[JobRun]:
        return [job for job in self.jobs if job.result == "Failed"]

    def seconds(self, now: datetime | None = None) -> float | None:
        """Returns how long it took, or has taken so far; None before its start."""
        if not self.started:
            return None
        end = datetime.fromisoformat(self.ended) if self.ended else now or datetime.now(UTC)
        return max(0.0, (end - datetime.fromisoformat(self.started)).total_seconds())


def has_ended(app: Json) -> bool:
    """Returns whether all instances of the app have ended. An app whose spec is refused is Failed, too, and its pods may run on."""
    is_refused = condition(app, Condition.ACCEPTED).get("status") == "False"
    return status(app).get("phase") in ENDED and not is_refused


async def list_runs(session: Session, app: Json) -> list[Run]:
    """Returns the runs of the app by the names of their instances."""
    selector = f"{Label.APP_UID}={meta(app)['uid']}"
    jobs = (await session.client.list(JOBS, namespace=session.home, label_selector=selector)).items
    pods = (await session.client.list(PODS, namespace=session.home, label_selector=selector)).items
    instances = await instances_of(session, app)
    return collect_runs(instances, jobs, pods)


def collect_runs(instances: Iterable[Instance], jobs: Iterable[Json], pods: Iterable[Json]) -> list[Run]:
    """Returns the runs, each with its Jobs by component and their pods by age."""
    pods_of: defaultdict[str, list[Json]] = defaultdict(list)
    for pod in sorted(pods, key=lambda pod: str(meta(pod).get("creationTimestamp") or "")):
        for owner in meta(pod).get("ownerReferences") or ():
            pods_of[str(owner.get("uid"))].append(pod)
    jobs_of: defaultdict[str, list[JobRun]] = defaultdict(list)
    for job in jobs:
        job_run = JobRun(job, pods_of[str(meta(job).get("uid"))])
        if not job_run.is_mark:
            jobs_of[label(job, Label.INSTANCE)].append(job_run)
    return [
        Run(instance, sorted(jobs_of[instance.name], key=lambda job: job.component))
        for instance in sorted(instances, key=lambda instance: instance.name)
    ]


async def read_kubelets(session: Session, runs: Iterable[Run]) -> dict[str, str]:
    """Returns the kubelet's version by node, as far as the user may read nodes that still exist."""
    names = {str((pod.get("spec") or {}).get("nodeName") or "") for run in runs for job in run.jobs for pod in job.pods}
    versions: dict[str, str] = {}
    for name in sorted(names - {""}):
        try:
            node = await session.client.get(NODES, name)
        except Forbidden:
            return versions
        except NotFound:
            continue
        versions[name] = str((status(node).get("nodeInfo") or {}).get("kubeletVersion") or "")
    return versions


def describe_provenance(app: Json, run: Run, kubelets: dict[str, str]) -> Json:
    """Returns what a run was run with and how it ended, as plain JSON."""
    values = run.values
    return {
        "app": meta(app).get("name"),
        "namespace": meta(app).get("namespace"),
        "appUID": meta(app).get("uid"),
        "run": run.instance.name,
        "parameters": values,
        "seed": values.get(SEED),
        "phase": run.phase,
        "startTime": run.started or None,
        "endTime": run.ended or None,
        "seconds": run.seconds(),
        "restarts": run.restarts,
        "domain": run.instance.domain,
        "jobs": [_describe_job(job, kubelets) for job in run.jobs],
    }


def _describe_job(job: JobRun, kubelets: dict[str, str]) -> Json:
    annotations = meta(job.obj).get("annotations") or {}
    return {
        "component": job.component,
        "dueTime": job.due or None,
        "job": meta(job.obj).get("name"),
        "result": job.result,
        "reason": job.reason or None,
        "attempt": read_number(annotations, Annotation.ATTEMPT),
        "startTime": job.started or None,
        "endTime": job.ended or None,
        "exitCode": job.exit_code,
        "failedPods": int(status(job.obj).get("failed") or 0),
        "specHash": annotations.get(Annotation.SPEC_HASH),
        "operatorVersion": annotations.get(Annotation.RENDERED_BY),
        "pods": [_describe_pod(pod, job.component, kubelets) for pod in job.pods],
    }


def _describe_pod(pod: Json, component: str, kubelets: dict[str, str]) -> Json:
    statuses = status(pod).get("containerStatuses") or []
    node = str((pod.get("spec") or {}).get("nodeName") or "")
    return {
        "name": meta(pod).get("name"),
        "node": node or None,
        "kubeletVersion": kubelets.get(node) or None,
        "phase": status(pod).get("phase"),
        "exitCode": _exit_code(pod, component),
        "images": [
            {
                "container": container.get("name"),
                "image": container.get("image"),
                "digest": container.get("imageID") or None,
            }
            for container in statuses
        ],
    }


def _exit_code(pod: Json, container: str) -> int | None:
    for container_status in status(pod).get("containerStatuses") or []:
        final_state = (container_status.get("state") or {}).get("terminated")
        if container_status.get("name") == container and final_state:
            return int(final_state.get("exitCode", 0))
    return None
