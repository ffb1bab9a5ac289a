"""Tenants fill the memory of operator and scheduler with objects as large as the API server takes."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from campaigns.common.process_use import peak_rss_bytes
from campaigns.hostile.attack import MIB, READY_S, Outcome, judge, read_memory_limit, register
from campaigns.hostile.bystanders import Bystanders, measure_calm
from campaigns.hostile.intruder import Intruder, Json, intruding
from campaigns.operating.large_apps import SHAPES, await_quiet, make_text_app
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_api.model.names import SCHEDULER_NAME, Reason
from robotapp_testbed import wait_until

APPS: Final[Mapping[str, int]] = {"text": 100, "parts": 95, "environment": 5}
"""Suspended apps of the largest accepted size, by shape."""
MANY_ANNOTATIONS: Final = {f"a{number}": "" for number in range(18_000)}
LONG_ANNOTATION: Final = {"a": "x" * 250_000}
OTHERS_AFTER: Final = 2
"""Apps of others that are awaited when all objects are there."""
PATIENCE_S: Final = 180.0
PODS: Final = "/api/v1/namespaces/{}/pods"
CONFIGMAPS: Final = "/api/v1/namespaces/{}/configmaps"
DEPLOYMENTS: Final = "/apis/apps/v1/namespaces/{}/deployments"


@register("large-apps", f"{sum(APPS.values())} suspended apps of the largest accepted size, and one that is larger")
def hoard_apps(site: SimulatedSite) -> Outcome:
    def attack(intruder: Intruder) -> dict[str, float]:
        names = [f"{shape}-{number}" for shape, count in APPS.items() for number in range(count)]
        for name in names:
            intruder.create(SHAPES[name.partition("-")[0]](name))
        larger = make_text_app("larger")
        components = larger["spec"]["components"] * 2
        larger["spec"]["components"] = [{**component, "name": f"c{n}"} for n, component in enumerate(components)]
        intruder.create(larger)

        def is_refused() -> bool:
            accepted = intruder.read_condition("larger", "Accepted")
            return accepted.get("reason") == Reason.TOO_LARGE and "at most 512 KiB" in accepted["message"]

        def count_unread() -> int:
            return sum(not app.get("status", {}).get("observedGeneration") for app in intruder.list_apps())

        has_refusal = wait_until(is_refused, timeout_s=PATIENCE_S, poll_s=0.5)
        wait_until(lambda: not count_unread(), timeout_s=PATIENCE_S, poll_s=2.0)
        return {"apps without a status": float(count_unread()), "larger apps not refused": float(not has_refusal)}

    return measure_hoard(site, attack)


@register("annotated-pods", "81 pods of 18,000 annotations each, and as many Deployments with a quarter of a megabyte")
def hoard_pods(site: SimulatedSite) -> Outcome:
    def attack(intruder: Intruder) -> dict[str, float]:
        for number in range(81):
            intruder.api.create(PODS.format(intruder.namespace), make_pod(f"pod-{number}", MANY_ANNOTATIONS))
            intruder.api.create(DEPLOYMENTS.format(intruder.namespace), make_deployment(f"deployment-{number}"))
        return {}

    return measure_hoard(site, attack, role="edit")


@register("annotated-configmaps", "800 ConfigMaps with annotations of 250 kB each")
def hoard_configmaps(site: SimulatedSite) -> Outcome:
    def attack(intruder: Intruder) -> dict[str, float]:
        for number in range(800):
            body = {"metadata": {"name": f"map-{number}", "annotations": LONG_ANNOTATION}}
            intruder.api.create(CONFIGMAPS.format(intruder.namespace), body)
        return {}

    return measure_hoard(site, attack, role="edit")


def measure_hoard(
    site: SimulatedSite, attack: Callable[[Intruder], Mapping[str, float]], *, role: str = "robotapp-editor"
) -> Outcome:
    """Runs the attack beside bystanders, then starts a further operator that lists everything at once. Figures of the attack must be 0."""
    calm_s = measure_calm(site, "hoard")
    with intruding(site, "hoard", role=role) as intruder:
        with Bystanders(site, "beside-hoard") as bystanders:
            extra = attack(intruder)
            bystanders.wait_for_more(OTHERS_AFTER)
        starting = site.another_operator()
        await_quiet(starting)
    figures = {
        **extra,
        "operator MiB peak": peak_rss_bytes(site.operator.pid) / MIB,
        "started operator MiB peak": peak_rss_bytes(starting.pid) / MIB,
        "scheduler MiB peak": peak_rss_bytes(site.scheduler.pid) / MIB,
        "restarts": float(sum(not process.running for process in (site.operator, site.scheduler, starting))),
        "others' apps Ready before s": calm_s,
        "others' apps Ready s": bystanders.slowest_s,
        "others' apps": float(len(bystanders.ready_s)),
    }
    operator_mib = read_memory_limit("operator") / MIB
    most = {
        **dict.fromkeys(extra, 0),
        "operator MiB peak": operator_mib,
        "started operator MiB peak": operator_mib,
        "scheduler MiB peak": read_memory_limit("scheduler") / MIB,
        "restarts": 0,
        "others' apps Ready s": max(READY_S, calm_s),
    }
    return judge(figures, most)


def make_pod(name: str, annotations: Mapping[str, str]) -> Json:
    return {"metadata": {"name": name, "annotations": dict(annotations)}, "spec": _make_pod_spec()}


def make_deployment(name: str) -> Json:
    """Returns a Deployment without pods."""
    labels = {"app": name}
    spec = {
        "replicas": 0,
        "selector": {"matchLabels": labels},
        "template": {"metadata": {"labels": labels}, "spec": _make_pod_spec()},
    }
    return {"metadata": {"name": name, "annotations": LONG_ANNOTATION}, "spec": spec}


def _make_pod_spec() -> dict[str, Any]:
    return {"schedulerName": SCHEDULER_NAME, "containers": [{"name": "main", "image": "registry.example/main:1"}]}
