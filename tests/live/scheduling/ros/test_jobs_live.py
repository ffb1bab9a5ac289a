"""A Job of runs that end, as the how-to page has it: every run in a domain of its own, which is free again afterwards."""

from pathlib import Path

import pytest
import yaml

from campaigns.rigs.stage import CLAIMS, Json, Stage, nodes
from robotapp_api.model.names import Annotation
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import edge

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("scheduler", "short_rest")]
EXAMPLE = Path(__file__).resolve().parents[4] / "examples" / "runs.yaml"


def test_ten_runs_four_at_a_time_never_share_a_domain_and_give_all_of_them_back(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    job = yaml.safe_load(EXAMPLE.read_text())
    path = f"/apis/batch/v1/namespaces/{stage.namespace}/jobs"

    def list_runs() -> list[Json]:
        return stage.pods(**{"batch.kubernetes.io/job-name": "runs"})

    def is_complete() -> bool:
        status: Json = installed_plane.api.get(f"{path}/runs")["status"]
        running = [read_domain(run) for run in list_runs() if run["status"]["phase"] in ("Pending", "Running")]
        bound = [domain for domain in running if domain]
        assert len(bound) <= job["spec"]["parallelism"]
        assert len(set(bound)) == len(bound), f"two runs in one domain: {sorted(bound)}"
        return bool(status.get("succeeded", 0) == job["spec"]["completions"])

    def list_claims() -> list[Json]:
        claims: list[Json] = installed_plane.api.get(CLAIMS)["items"]
        return [claim for claim in claims if claim["spec"]["holder"]["namespace"] == stage.namespace]

    with nodes(installed_plane, edge("edge-1"), edge("edge-2")):
        installed_plane.api.create(path, job)
        stage.wait(is_complete, what=lambda: f"not all runs have ended: {installed_plane.api.get(f'{path}/runs')}")
        assert all(read_domain(run).isdigit() for run in list_runs())
        stage.wait(lambda: not list_claims(), what=lambda: f"domains are not given back: {list_claims()}")


def read_domain(run: Json) -> str:
    """Returns the granted domain of a pod, "" before it has one."""
    return str(run["metadata"].get("annotations", {}).get(str(Annotation.GRANTED_DOMAIN), ""))
