"""The configuration of the thesis (listing 3.11, with apiVersion and kind) through the loader of configurations."""

from pathlib import Path

from robotapp_scheduler.config.load import SchedulerConfig, load, parse_text
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.plugins import registry
from robotapp_scheduler.plugins.ros.latency_filter import LatencyFilter

LISTING = Path(__file__).resolve().parents[2] / "golden" / "thesis" / "scheduler" / "listing-3.11.yaml"
ROS_SCORES = {"TopologyScore": 10, "LatencyScore": 5, "LoadBalanceScore": 3, "DeadlineScore": 8}


def listing() -> SchedulerConfig:
    return load(LISTING, catalogue=registry.catalogue())


def only_profile(found: SchedulerConfig) -> Profile:
    (profile,) = found.build().values()
    return profile


def test_it_is_taken_as_it_stands_and_one_argument_is_named_as_ignored() -> None:
    found = listing()
    assert found.scheduler_names == ("kubernetes-scheduler",)
    (warning,) = found.warnings
    assert warning.startswith(
        "profiles[0].pluginConfig[0].args.cacheTTL is accepted and ignored: the scheduler probes nothing"
    )


def test_its_plugins_weights_and_arguments_are_at_work() -> None:
    profile = only_profile(listing())
    assert profile.queue_sort.name == "ROSQueueSort"
    filters = [each.name for each in profile.filters]
    assert {"LatencyFilter", "HardwareAffinityFilter", "SharedDataFilter"} <= set(filters)
    scores = {each.name: each.weight for each in profile.scores}
    assert ROS_SCORES.items() <= scores.items()
    latency = profile.all["LatencyFilter"].plugin
    assert isinstance(latency, LatencyFilter)
    assert (latency.most_us, latency.deny_unknown, latency.row_local) == (100_000, False, True)


def test_what_it_leaves_out_stays_so_that_domains_and_devices_are_claimed() -> None:
    profile = only_profile(listing())
    assert profile.reserves_devices
    assert "ROSBind" in profile.all
    assert "NodeResourcesFit" in profile.all


def test_an_ignored_argument_needs_no_value_that_makes_sense_and_changes_nothing() -> None:
    text = LISTING.read_text()
    other = parse_text(text.replace("30s", "soon"), catalogue=registry.catalogue())
    assert other.digest == listing().digest
    without = parse_text(text.replace('cacheTTL: "30s"', "unknown: Allow"), catalogue=registry.catalogue())
    assert without.warnings == ()
