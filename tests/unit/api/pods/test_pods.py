"""Further containers, volumes and shared memory of a component's pod: what cannot work is refused with the cure."""

from typing import Any

import pytest
from tests.support.factories import component

from robotapp_api.checks.spec import spec_notes, spec_problems
from robotapp_api.model.app.robotapp import RobotAppSpec

Json = dict[str, Any]
BESIDE: Json = {"name": "beside", "image": "x"}


def spec_of(*components: Json) -> RobotAppSpec:
    return RobotAppSpec.model_validate({"ros": {"distro": "jazzy"}, "components": list(components)})


def driver(**pod: Any) -> Json:
    return component("driver", template={"spec": pod})


@pytest.mark.parametrize(
    ("body", "field", "cure"),
    [
        (driver(containers=[BESIDE | {"name": "driver"}]), "containers[0].name", "is the name of the component itself"),
        (driver(containers=[BESIDE | {"name": "wait-for-names"}]), "containers[0].name", "the operator's own step"),
        (driver(containers=[BESIDE], initContainers=[BESIDE]), "containers[0].name", "another container of the pod"),
        (
            driver(containers=[BESIDE | {"volumeMounts": [{"name": "v", "mountPath": "/v"}]}]),
            "containers[0].volumeMounts[0].name",
            'there is no volume "v"',
        ),
        (driver(containers=[BESIDE | {"env": [{"name": "ROS_DOMAIN_ID", "value": "1"}]}]), "containers[0].env", "spec.ros2.domain"),
        (driver(containers=[BESIDE | {"lifecycle": {"stopSignal": "SIGINT"}}]), "stopSignal", "preStop"),
        (
            driver(volumes=[{"name": "robotapp-shared-memory", "emptyDir": {}}]),
            "volumes[0].name",
            "is the volume of sharedMemory",
        ),
        (
            driver(volumes=[{"name": "v", "emptyDir": {}}])
            | {"sharedMemory": {"size": "1Gi"}, "volumeMounts": [{"name": "v", "mountPath": "/dev/shm/"}]},  # noqa: S108
            "volumeMounts[0].mountPath",
            "remove this mount",
        ),
        (driver() | {"sharedMemory": {"size": 0}}, "sharedMemory.size", "write for example 512Mi"),
    ],
)  # fmt: skip
def test_what_cannot_work_in_a_pod_is_refused_with_the_cure(body: Json, field: str, cure: str) -> None:
    problems = [problem for problem in spec_problems(spec_of(body)) if problem.field.endswith(field)]
    assert len(problems) == 1
    assert cure in problems[0].message


def test_a_pod_with_sidecars_volumes_and_memory_is_accepted() -> None:
    mount = {"volumeMounts": [{"name": "v", "mountPath": "/v"}]}
    body = driver(
        containers=[BESIDE | mount], initContainers=[BESIDE | {"name": "web"}], volumes=[{"name": "v", "emptyDir": {}}]
    )
    assert list(spec_problems(spec_of(body | {"sharedMemory": {"size": "1Gi"}}))) == []


def test_shared_memory_beyond_the_memory_limit_is_told() -> None:
    limits = {"resources": {"limits": {"memory": "512Mi"}}}
    (note,) = (note for note in spec_notes(spec_of(driver() | limits | {"sharedMemory": {"size": "1Gi"}})))
    assert "counts towards its memory limit 512Mi" in note.message
    assert list(spec_notes(spec_of(driver() | limits | {"sharedMemory": {"size": "256Mi"}}))) == []
