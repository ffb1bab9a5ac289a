"""Configurations a decoder would let through, and which nobody can have meant: with all built-in plugins."""

from functools import partial
from typing import Any

import pytest
from tests.support.scheduler.broken_plugins import UNUSABLE
from tests.support.wrong_input import configurations
from tests.support.wrong_input.configurations import profile

from robotapp_scheduler.config.model import API_VERSION
from robotapp_scheduler.plugins.kubernetes.node.added_affinity import PREFERRED, REQUIRED
from robotapp_scheduler.plugins.registry import catalogue

config = partial(configurations.config, catalogue())
problems = partial(configurations.problems, catalogue())


def weight(value: int) -> dict[str, Any]:
    return configurations.plugins("score", {"name": "ImageLocality", "weight": value})


def terms(**expression: Any) -> dict[str, Any]:
    found = {"key": "pool", "operator": "In", "values": ["robots"]} | expression
    return {"nodeSelectorTerms": [{"matchExpressions": [found]}]}


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        (weight(1 << 31), "profiles[0].plugins.score.enabled[0].weight: Invalid value: 2147483648"),
        ({"podMaxBackoffSeconds": 10**400}, "podMaxBackoffSeconds: Invalid value: 1000"),
        (
            configurations.args("VolumeBinding", bindTimeoutSeconds=1 << 63),
            "profiles[0].pluginConfig[VolumeBinding].args: bindTimeoutSeconds: more than the format can hold",
        ),
        ({"clientConnection": {"qps": "5"}}, 'clientConnection.qps: Invalid value: "5"'),
        ({"profiles": [{"schedulerName": ""}, {"schedulerName": "b"}]}, "profiles[0].schedulerName: Required value"),
        (
            {"leaderElection": {"leaderElect": False, "retryPeriod": "soon"}},
            'leaderElection.retryPeriod: Invalid value: "soon"',
        ),
    ],
)
def test_numbers_the_format_cannot_hold_and_empty_names_are_refused(fields: dict[str, Any], text: str) -> None:
    assert problems(**fields)[0].startswith(text)


@pytest.mark.parametrize(
    ("added", "text"),
    [
        ({"requiredDuringSchedulingIgnoredDuringExection": {}}, "unknown field `requiredDuringSchedulingIgnoredDuringExection`"),
        ({"podAffinity": {}}, "unknown field `podAffinity`"),
        ({REQUIRED: {"nodeSelectorTerms": []}}, "nodeSelectorTerms: Required value: must have at least one"),
        ({REQUIRED: terms(key="!!")}, 'nodeSelectorTerms[0].matchExpressions[0].key: Invalid value: "!!"'),
        ({REQUIRED: terms(operator="Gt", values=["x"])}, 'matchExpressions[0].values[0]: Invalid value: "x"'),
        ({REQUIRED: terms(operator="Gt", values=[])}, "matchExpressions[0].values: Required value"),
        ({REQUIRED: terms(operator="In", values=[])}, "matchExpressions[0].values: Required value"),
        ({REQUIRED: terms(operator="Exists", values=["1"])}, "matchExpressions[0].values: Forbidden"),
        ({REQUIRED: terms(operator="In", values=["a b"])}, 'matchExpressions[0].values[0]: Invalid value: "a b"'),
        ({REQUIRED: {"nodeSelectorTerms": [{"matchFields": [{"key": "spec", "operator": "Exists"}]}]}}, "matchFields[0].key"),
        ({PREFERRED: [{"weight": 0, "preference": {}}]}, "weight: Invalid value: 0: must be in the range 1-100"),
    ],
)  # fmt: skip
def test_an_added_affinity_the_api_server_would_refuse_in_a_pod_is_refused(added: dict[str, Any], text: str) -> None:
    (problem,) = problems(**configurations.args("NodeAffinity", addedAffinity=added))
    assert text in problem


@pytest.mark.parametrize(
    ("args", "texts"),
    [
        ({"kind": "VolumeBindingArgs"}, ['args.kind: Invalid value: "VolumeBindingArgs": must be "NodeResourcesFitArgs"']),
        ({"apiVersion": "v7"}, [f'args.apiVersion: Invalid value: "v7": must be "{API_VERSION}"']),
        ({"apiVersion": API_VERSION, "kind": "NodeResourcesFitArgs"}, []),
    ],
)  # fmt: skip
def test_arguments_that_say_they_are_another_plugins_are_refused(args: dict[str, Any], texts: list[str]) -> None:
    fields = configurations.args("NodeResourcesFit", **args)
    expected = [f"profiles[0].pluginConfig[0].{text}" for text in texts]
    assert (problems(**fields) if texts else list(config(**fields).warnings)) == expected


def test_arguments_of_a_plugin_that_is_switched_off_are_read_all_the_same() -> None:
    off = {"multiPoint": {"disabled": [{"name": "ImageLocality"}]}}
    fields = profile(plugins=off, pluginConfig=[{"name": "ImageLocality", "args": {"typo": 1}}])
    assert problems(**fields) == ["profiles[0].pluginConfig[ImageLocality].args: Object contains unknown field `typo`"]


def test_profiles_must_give_the_queue_sort_plugin_the_same_arguments() -> None:
    thesis = [{"name": "ROSQueueSort", "args": {"order": "Thesis"}}]
    profiles = [{"schedulerName": "a"}, {"schedulerName": "b", "pluginConfig": thesis}]
    assert problems(profiles=profiles) == [
        "profiles: the arguments of ROSQueueSort must be the same for all profiles: it orders one queue"
    ]
    assert config(profiles=[{**each, "pluginConfig": thesis} for each in profiles]).scheduler_names == ("a", "b")


@pytest.mark.parametrize(("plugin", "said"), UNUSABLE.items(), ids=lambda value: getattr(value, "__name__", ""))
def test_a_plugin_that_cannot_work_is_a_mistake_of_the_configuration(plugin: type, said: str) -> None:
    enabled = {"enabled": [{"name": f"tests.support.scheduler.broken_plugins:{plugin.__name__}"}]}
    (problem,) = problems(**profile(plugins={"multiPoint": enabled}))
    assert problem.startswith("profiles[0].plugins: ")
    assert said in problem


def test_a_name_that_disables_nothing_is_told_in_the_log() -> None:
    off = {"score": {"disabled": [{"name": "*"}, {"name": "NodeAffinity"}, {"name": "ImageLocalty"}]}}
    assert config(**profile(plugins=off)).warnings == (
        'profiles[0].plugins.score.disabled[2].name: no plugin is called "ImageLocalty": nothing is disabled by it',
    )
