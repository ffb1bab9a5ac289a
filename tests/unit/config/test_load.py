from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.support.wrong_input import configurations
from tests.support.wrong_input.configurations import profile

from robotapp_api.model.names import SCHEDULER_NAME, THESIS_SCHEDULER_NAME
from robotapp_scheduler.config.load import ConfigError, SchedulerConfig, built_in, load, parse_text
from robotapp_scheduler.config.model import API_VERSION, KIND
from robotapp_scheduler.core.framework.profiles import Catalogue, PluginRef
from robotapp_scheduler.plugins import registry


class Fake:
    """A plugin class by name; the hooks of each are added below."""

    name = "Fake"


def fake(name: str, *hooks: str, args: type[msgspec.Struct] | None = None) -> type:
    members: dict[str, Any] = {"name": name, **{hook: lambda *_: None for hook in hooks}}
    if args is not None:
        members |= {"Args": args, "__init__": lambda self, args: setattr(self, "args", args)}
    return type(name, (Fake,), members)


class Strategy(msgspec.Struct, rename="camel", forbid_unknown_fields=True):
    type: str = "LeastAllocated"


class FitArgs(msgspec.Struct, rename="camel", forbid_unknown_fields=True):
    scoring_strategy: Strategy = msgspec.field(default_factory=Strategy)


CLASSES = {
    "ROSQueueSort": fake("ROSQueueSort", "queue_key"),
    "PrioritySort": fake("PrioritySort", "queue_key"),
    "NodeName": fake("NodeName", "filter"),
    "NodeAffinity": fake("NodeAffinity", "filter", "score"),
    "NodeResourcesFit": fake("NodeResourcesFit", "filter", "score", args=FitArgs),
    "TopologyScore": fake("TopologyScore", "score"),
    "DefaultBinder": fake("DefaultBinder", "bind"),
}
DEFAULTS = (
    PluginRef("ROSQueueSort"),
    PluginRef("NodeName"),
    PluginRef("NodeAffinity", 2),
    PluginRef("NodeResourcesFit", 1),
    PluginRef("TopologyScore", 10),
    PluginRef("DefaultBinder"),
)


def catalogue() -> Catalogue:
    return Catalogue(classes=CLASSES, defaults=DEFAULTS)


def scored(found: SchedulerConfig) -> list[tuple[str, int]]:
    first = found.build()[found.scheduler_names[0]]
    return [(loaded.name, loaded.weight) for loaded in first.scores]


config = partial(configurations.config, catalogue())
problems = partial(configurations.problems, catalogue())


def test_without_a_file_both_scheduler_names_are_served_with_the_same_plugins() -> None:
    found = load(None, catalogue=catalogue())
    assert found.scheduler_names == (SCHEDULER_NAME, THESIS_SCHEDULER_NAME)
    first, second = found.build().values()
    assert [each.name for each in first.filters] == [each.name for each in second.filters]
    assert found.leader_election.name == "robotapp-scheduler"
    assert (found.leader_election.lease_s, found.leader_election.renew_s, found.leader_election.retry_s) == (15, 10, 2)


def test_one_nameless_profile_gets_our_scheduler_name() -> None:
    assert config(profiles=[{}]).profiles[0].scheduler_name == SCHEDULER_NAME


def test_a_file_of_kube_scheduler_is_read_with_its_weights_and_arguments(tmp_path: Path) -> None:
    file = tmp_path / "config.yaml"
    file.write_text(f"""
apiVersion: {API_VERSION}
kind: {KIND}
leaderElection: {{leaderElect: false}}
clientConnection: {{qps: 10000, burst: 20000, kubeconfig: /etc/k}}
profiles:
- schedulerName: mine
  plugins:
    score:
      enabled: [{{name: TopologyScore, weight: 4}}]
      disabled: [{{name: NodeAffinity}}]
  pluginConfig:
  - name: NodeResourcesFit
    args:
      apiVersion: {API_VERSION}
      kind: NodeResourcesFitArgs
      scoringStrategy: {{type: MostAllocated}}
""")
    found = load(file, catalogue=catalogue())
    assert scored(found) == [("TopologyScore", 4), ("NodeResourcesFit", 1)]
    fit = found.build()["mine"].all["NodeResourcesFit"].plugin
    assert fit.args.scoring_strategy.type == "MostAllocated"
    assert found.kubeconfig == "/etc/k"
    assert "qps" in found.warnings[0]
    assert not found.leader_election.enabled


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"parallelism": 0}, "parallelism: Invalid value: 0: should be an integer value greater than zero"),
        ({"percentageOfNodesToScore": 101}, "percentageOfNodesToScore: Invalid value: 101: not in valid range [0-100]"),
        ({"podInitialBackoffSeconds": 0}, "podInitialBackoffSeconds: Invalid value: 0: must be greater than 0"),
        (
            {"podMaxBackoffSeconds": 0},
            "podMaxBackoffSeconds: Invalid value: 0: must be greater than or equal to PodInitialBackoffSeconds",
        ),
        (
            {"leaderElection": {"resourceLock": "endpoints"}},
            'leaderElection.resourceLock: Invalid value: "endpoints": resourceLock value must be "leases"',
        ),
        ({"unknownField": 1}, 'strict decoding error: unknown field "unknownField"'),
        (
            {"profiles": [{"plugins": {"score": {"enable": []}}}]},
            'strict decoding error: unknown field "profiles[0].plugins.score.enable"',
        ),
        (
            {"profiles": [{"pluginConfig": [{"name": "NodeResourcesFit", "args": {"scoring": {}}}]}]},
            "profiles[0].pluginConfig[NodeResourcesFit].args: Object contains unknown field `scoring`",
        ),
        (
            {"profiles": [{"schedulerName": "mine"}, {"schedulerName": "mine"}]},
            'profiles[1].schedulerName: Duplicate value: "profiles[0].schedulerName"',
        ),
        ({"profiles": [{"schedulerName": "mine"}, {}]}, "profiles[1].schedulerName: Required value"),
        (
            {"extenders": [{"urlPrefix": "http://x"}]},
            "extenders: not supported here: an HTTP round trip per pod; write a plugin (module:Class) instead",
        ),
        (
            {"compatVersion": "1.20"},
            'compatVersion: Unsupported value: "1.20": supported values: "1.35", "1.37"',
        ),
        (
            profile(plugins={"multiPoint": {"enabled": [{"name": "PrioritySort"}]}}),
            "profiles[0].plugins.queueSort: only one queue sort plugin can be enabled, and one must be: ROSQueueSort, PrioritySort",
        ),
        (
            profile(plugins={"filter": {"enabled": [{"name": "DefaultBinder"}]}}),
            "profiles[0].plugins.filter: plugin 'DefaultBinder' does not take part at this point",
        ),
        (
            profile(plugins={"multiPoint": {"disabled": [{"name": "DefaultBinder"}]}}),
            "profiles[0].plugins.bind: at least one bind plugin is needed",
        ),
        (
            profile(plugins={"multiPoint": {"enabled": [{"name": "A.b"}]}}),
            (
                'profiles[0].plugins.multiPoint.enabled[0].name: plugin "A.b" cannot be loaded: '
                "no plugin and no entry point of this name; write module:Class for a file of your own"
            ),
        ),
        (
            profile(plugins={"score": {"enabled": [{"name": "NodeResorcesFit"}]}}),
            (
                'profiles[0].plugins.score.enabled[0].name: plugin "NodeResorcesFit" cannot be loaded: no plugin and no entry '
                'point of this name; write module:Class for a file of your own (did you mean "NodeResourcesFit"?)'
            ),
        ),
        (
            profile(plugins={"postFilter": {"enabled": [{"name": "TopologyScore"}]}}),
            "profiles[0].plugins.postFilter: plugin 'TopologyScore' does not take part at this point",
        ),
    ],
)
def test_a_mistake_is_told_with_its_path_and_what_is_allowed(fields: dict[str, Any], text: str) -> None:
    assert problems(**fields) == [text]


def test_all_mistakes_are_reported_in_one_bracketed_list() -> None:
    with pytest.raises(ConfigError) as caught:
        config(parallelism=0, podInitialBackoffSeconds=-1)
    assert str(caught.value).startswith("[parallelism: Invalid value: 0")
    assert str(caught.value).endswith("must be greater than 0]")


def test_upstream_plugins_that_are_not_built_are_named_as_such() -> None:
    plugins = {"score": {"enabled": [{"name": "GangScheduling", "weight": 3}]}}
    assert problems(**profile(plugins=plugins)) == [
        (
            "profiles[0].plugins.score.enabled[0].name: not supported here: "
            'plugin "GangScheduling": the pods of a PodGroup are planned whole without it'
        )
    ]


def test_disabling_what_is_not_built_is_harmless() -> None:
    plugins = {"postFilter": {"disabled": [{"name": "*"}]}, "multiPoint": {"disabled": [{"name": "InterPodAffinity"}]}}
    assert len(scored(config(**profile(plugins=plugins)))) == 3


def test_profiles_must_share_the_queue_sort_plugin() -> None:
    other = {"queueSort": {"enabled": [{"name": "PrioritySort"}], "disabled": [{"name": "*"}]}}
    profiles = [{"schedulerName": "a"}, {"schedulerName": "b", "plugins": other}]
    assert problems(profiles=profiles) == [
        "profiles: queueSort must be the same for all profiles, found PrioritySort, ROSQueueSort"
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: [", "strict decoding error: yaml"),
        (f"apiVersion: {API_VERSION}\nkind: {KIND}\nkind: {KIND}\n", 'key "kind" already set in map'),
        ("kind: Deployment\napiVersion: apps/v1\n", "apiVersion: Invalid value"),
        ("[]", "configuration: Invalid value: []: Input should be a mapping"),
        ("", "configuration: Invalid value: None: Input should be a mapping"),
        ("a: &a {b: 1}\nc:\n  <<: *a\n", 'line 3: "<<" is not read here: write the fields out'),
        ('a:\n- "\\ud800"\n', "invalid Unicode character escape code"),
    ],
)
def test_a_file_that_is_no_configuration_is_refused(tmp_path: Path, text: str, expected: str) -> None:
    file = tmp_path / "config.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=expected.replace("[", r"\[")):
        load(file, catalogue=catalogue())


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.yaml: No such file"):
        load(tmp_path / "none.yaml", catalogue=catalogue())


def test_a_third_party_plugin_is_loaded_by_module_and_class_with_its_arguments() -> None:
    name = "tests.support.scheduler.third_party_plugin:PreferQuietNodes"
    found = config(
        **profile(
            plugins={"multiPoint": {"enabled": [{"name": name, "weight": 7}]}},
            pluginConfig=[{"name": name, "args": {"quiet": "very"}}],
        )
    )
    assert scored(found)[-1] == ("PreferQuietNodes", 7)
    assert found.build()["mine"].all["PreferQuietNodes"].plugin.quiet == "very"


def test_equal_files_have_equal_digests_and_a_weight_changes_it() -> None:
    heavier = profile(plugins={"score": {"enabled": [{"name": "TopologyScore", "weight": 99}]}})
    assert config(**profile()).digest == config(**profile()).digest
    assert config(**profile()).digest != config(**heavier).digest


@pytest.mark.parametrize(
    ("fields", "path", "why"),
    [
        ({"parallelism": 4}, "parallelism", "one event loop"),
        ({"clientConnection": {"qps": 5}}, "clientConnection.qps", "fairness"),
        ({"percentageOfNodesToScore": 50}, "percentageOfNodesToScore", "all nodes are always filtered and scored"),
        (profile(percentageOfNodesToScore=1), "profiles[0].percentageOfNodesToScore", "all nodes"),
        (
            {"clientConnection": {"contentType": configurations.PROTOBUF}},
            "clientConnection.contentType",
            "what this client speaks",
        ),
        (
            {"leaderElection": {"resourceName": "kube-scheduler", "resourceNamespace": "kube-system"}},
            "leaderElection",
            "own Lease",
        ),
        ({"enableProfiling": True}, "enableProfiling", "no profiles"),
        ({"enableContentionProfiling": True}, "enableContentionProfiling", "no profiles"),
    ],
)
def test_what_has_no_effect_is_accepted_with_a_warning_that_names_it(
    fields: dict[str, Any], path: str, why: str
) -> None:
    (warning,) = config(**fields).warnings
    assert warning.startswith(path)
    assert why in warning


@pytest.mark.parametrize("point", ["placementGenerate", "placementScore", "podGroupPostFilter"])
def test_points_we_do_not_have_are_refused_only_where_something_is_enabled(point: str) -> None:
    assert config(**profile(plugins={point: {"disabled": [{"name": "*"}]}})).build()
    assert problems(**profile(plugins={point: {"enabled": [{"name": "NodeName"}]}})) == [
        f"profiles[0].plugins.{point}: not supported here: the pods of a group are planned whole without it"
    ]


def test_no_resources_and_no_shape_mean_the_usual_ones() -> None:
    def told(plugin: str, **fields: Any) -> Any:
        return real(**configurations.args(plugin, **fields)).build()["mine"].all[plugin].plugin

    empty = told("NodeResourcesFit", scoringStrategy={"type": "LeastAllocated", "resources": []})
    assert empty._resources == told("NodeResourcesFit")._resources
    assert len(empty._resources) == 2
    assert told("NodeResourcesBalancedAllocation", resources=[])._names == ("cpu", "memory")
    assert told("VolumeBinding", shape=[])._points[:2] == [100, 99]


def test_values_that_change_nothing_give_no_warning() -> None:
    assert built_in(catalogue()).warnings == ()
    assert config(percentageOfNodesToScore=100, **profile(percentageOfNodesToScore=0)).warnings == ()
    assert config(enableProfiling=False, enableContentionProfiling=False).warnings == ()


# --- Files of kube-scheduler with our own plugins --------------------------------------------------------------------


real = partial(configurations.config, registry.catalogue())


@pytest.mark.parametrize("what", configurations.ACCEPTED)
def test_what_kube_scheduler_accepts_is_accepted(what: str) -> None:
    assert real(**configurations.ACCEPTED[what]).build()


def test_empty_fields_of_the_election_and_times_of_zero_mean_their_defaults() -> None:
    empty = {"resourceName": "", "leaseDuration": "0s", "renewDeadline": "0", "retryPeriod": "0s"}
    assert real(leaderElection=empty).leader_election == real().leader_election
    given = real(leaderElection={"leaseDuration": "+.5m", "retryPeriod": "500000000ns"}).leader_election
    assert (given.lease_s, given.renew_s, given.retry_s) == (30.0, 10.0, 0.5)


@pytest.mark.parametrize(("fields", "text"), configurations.REFUSED.values(), ids=list(configurations.REFUSED))
def test_what_kube_scheduler_refuses_is_refused_with_its_words(fields: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        real(**fields)
    assert text in str(caught.value)


@pytest.mark.parametrize(("fields", "text"), configurations.OURS_ALONE.values(), ids=list(configurations.OURS_ALONE))
def test_what_we_do_not_support_is_refused_with_the_reason(fields: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        real(**fields)
    assert text in str(caught.value)


def test_the_release_to_follow_reaches_every_plugin_that_knows_releases_unless_the_plugin_says_otherwise() -> None:
    fields = configurations.args("VolumeBinding", compatVersion="1.37") | {"compatVersion": "1.35"}
    (spec,) = real(**fields).profiles
    told = {name: args["compatVersion"] for name, args in spec.plugin_config.items()}
    assert told == {
        "DefaultPreemption": "1.35",
        "ImageLocality": "1.35",
        "NodeDeclaredFeatures": "1.35",
        "NodeResourcesBalancedAllocation": "1.35",
        "NodeVolumeLimits": "1.35",
        "VolumeBinding": "1.37",
    }
    (usual,) = real(compatVersion="1.37", **profile()).profiles
    assert usual.plugin_config == {}


def test_unknown_fields_are_told_together_with_all_that_is_wrong_beside_them() -> None:
    found = problems(parallelism=0, typo=1, profiles=[{"plugin": {}, "percentageOfNodesToScore": 101}])
    assert set(found) == {
        'strict decoding error: unknown field "typo"',
        'strict decoding error: unknown field "profiles[0].plugin"',
        "parallelism: Invalid value: 0: should be an integer value greater than zero",
        "profiles[0].percentageOfNodesToScore: Invalid value: 101: not in valid range [0-100]",
    }


def test_names_are_those_of_the_file_format_and_no_others() -> None:
    assert problems(pod_max_backoff_seconds=5) == ['strict decoding error: unknown field "pod_max_backoff_seconds"']


@pytest.mark.parametrize(
    ("change", "fields"),
    [
        ({"podMaxBackoffSeconds": 20}, ()),
        ({"profiles": [{"schedulerName": "mine", "plugins": {"score": {"disabled": [{"name": "*"}]}}}]}, ()),
        ({"profiles": [{"schedulerName": "other"}]}, ("profiles[].schedulerName",)),
        ({"leaderElection": {"leaseDuration": "30s"}}, ("leaderElection",)),
        ({"clientConnection": {"kubeconfig": "/k"}, "leaderElection": {"leaderElect": False}},
         ("leaderElection", "clientConnection.kubeconfig")),
    ],
)  # fmt: skip
def test_what_cannot_be_exchanged_while_running_is_named(change: dict[str, Any], fields: tuple[str, ...]) -> None:
    running = config(**profile())
    assert running.restart_needed(config(**(profile() | change))) == fields


MILLIONS = "\n".join([f"a0: &a0 [{'x,' * 10}]", *(f"a{i}: &a{i} [{f'*a{i - 1},' * 10}]" for i in range(1, 9))])


@pytest.mark.parametrize(
    "text",
    ["a: [", "x" * ((1 << 20) + 1), "[" * 100_000, "null", "- a", "a: 1\na: 2", "a: &a [*a]", "a: &a {b: *a}", MILLIONS,
     "a: 2020-13-45", f"a: {'1' * 5000}", "? {a: b}\n: c", "\x00", "a: !!python/object/apply:os.system [id]"],
)  # fmt: skip
def test_a_text_that_is_no_configuration_is_a_problem_and_never_a_crash(text: str) -> None:
    with pytest.raises(ConfigError):
        parse_text(text, catalogue=catalogue())
