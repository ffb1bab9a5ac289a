"""When another content of ConfigMaps starts a component anew: never at an upgrade, at once for an edit, ever less often for what keeps changing."""

import itertools
from datetime import UTC, datetime, timedelta

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import component, make_app

from robotapp_operator.plan.spec.config_content import (
    ClusterConfig,
    ConfigContent,
    config_content,
    list_config_maps,
    reads_config,
)
from robotapp_operator.plan.spec.config_record import (
    PAUSES_S,
    QUIET,
    ConfigDecision,
    ConfigRecord,
    decide_config,
    parse_record,
    record_content,
)
from robotapp_operator.plan.spec.objects import ConfigMap

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)


def content(**digests: str) -> ConfigContent:
    return ConfigContent({f"ConfigMap {name}": digest for name, digest in digests.items()}, references="r")


def decide(
    record: ConfigRecord,
    now_content: ConfigContent,
    *,
    at: datetime = NOW,
    rolls_out: bool = True,
    startable: bool = True,
) -> ConfigDecision:
    return decide_config(record, now_content, file_hash="", absent=(), rolls_out=rolls_out, startable=startable, now=at)


def started_with(**digests: str) -> ConfigRecord:
    return record_content(content(**digests), file_hash="", absent=())


def test_the_first_content_that_is_seen_is_recorded_and_annotates_no_pod() -> None:
    record = started_with(drv="1")
    assert record.config_hash == ""
    assert decide(record, content(drv="1")) == ConfigDecision(record=record)


def test_another_content_starts_the_component_anew_at_once_and_is_named() -> None:
    decision = decide(started_with(drv="1", map="1"), content(drv="2", map="1"))
    assert decision.changed == ("ConfigMap drv",)
    assert decision.record.config_hash
    assert decide(decision.record, content(drv="2", map="1")).changed == ()


def test_the_first_content_that_comes_back_starts_it_anew_as_well() -> None:
    other = decide(started_with(drv="1"), content(drv="2")).record
    back = decide(other, content(drv="1"), at=NOW + timedelta(hours=3))
    assert back.changed == ("ConfigMap drv",)
    assert back.record.config_hash not in ("", other.config_hash)


def test_none_leaves_pods_running() -> None:
    decision = decide(started_with(drv="1"), content(drv="2"), rolls_out=False)
    assert (decision.changed, decision.held, decision.due) == ((), ("ConfigMap drv",), None)
    assert decision.held_text == ""


def test_what_vanishes_starts_nothing_and_its_return_with_the_same_content_neither() -> None:
    record = started_with(drv="1")
    gone = decide(record, content(drv="gone"), startable=False)
    assert (gone.record, gone.changed) == (record, ())
    assert decide(gone.record, content(drv="1")).changed == ()


def test_an_edit_of_what_the_component_refers_to_is_no_change_of_configuration() -> None:
    edited = ConfigContent({"ConfigMap other": "9"}, references="another")
    decision = decide(started_with(drv="1"), edited)
    assert decision.changed == ()
    assert decision.record.mounted == {"ConfigMap other": "9"}


def test_secrets_that_are_followed_from_now_on_or_no_longer_start_nothing() -> None:
    record = started_with(drv="1")
    followed = ConfigContent({"ConfigMap drv": "1", "Secret s": "7"}, references="r")
    decision = decide(record, followed)
    assert decision.changed == ()
    assert decision.record.mounted == followed.mounted
    assert decide(decision.record, content(drv="1")).changed == ()
    assert decide(decision.record, ConfigContent({"ConfigMap drv": "1", "Secret s": "8"}, references="r")).changed == (
        "Secret s",
    )


def test_a_config_map_that_changes_every_two_seconds_restarts_less_and_less_often_and_that_is_told() -> None:
    record, restarts, texts = started_with(drv="0"), [], set()
    for second in range(0, 6 * 3600, 2):
        at = NOW + timedelta(seconds=second)
        decision = decide(record, content(drv=str(second + 1)), at=at)
        if decision.changed:
            restarts.append(second)
        texts.add(decision.held_text)
        record = decision.record
    pauses = [later - earlier for earlier, later in itertools.pairwise(restarts)]
    assert pauses[: len(PAUSES_S) - 1] == [*PAUSES_S[1:]]
    assert set(pauses[len(PAUSES_S) :]) == {PAUSES_S[-1]}
    assert any(
        "ConfigMap drv changed again after 8 restarts for changes; the next one is at 2026-" in text for text in texts
    )


def test_after_quiet_hours_a_change_is_rolled_out_at_once_again() -> None:
    record = started_with(drv="0")
    for number in range(1, 8):
        record = decide(record, content(drv=str(number)), at=NOW + timedelta(hours=number)).record
    later = NOW + timedelta(hours=7) + QUIET
    decision = decide(record, content(drv="x"), at=later)
    assert decision.changed
    assert decision.record.rolls == 1


def test_a_restart_in_the_future_of_another_clock_holds_nothing() -> None:
    record = decide(started_with(drv="0"), content(drv="1"), at=NOW + timedelta(days=1)).record
    assert decide(record, content(drv="2")).changed


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(1, 4000)), max_size=60))
def test_restarts_are_never_closer_than_their_pause_and_the_last_content_always_arrives(
    steps: list[tuple[int, int]],
) -> None:
    record, at, last = started_with(drv="0"), NOW, None
    for digest, seconds in steps:
        at += timedelta(seconds=seconds)
        before = record
        decision = decide(record, content(drv=str(digest)), at=at)
        record = decision.record
        assert bool(decision.changed) == (record.config_hash != before.config_hash or record.at != before.at)
        if decision.changed:
            assert last is None or (at - last).total_seconds() >= PAUSES_S[min(before.rolls, len(PAUSES_S) - 1)] - 1
            last = at
        assert parse_record(record.text()) == record
    final = decide(record, content(drv="final"), at=at + timedelta(hours=1, seconds=1))
    assert final.record.mounted == content(drv="final").mounted


@given(st.text() | st.binary().map(lambda data: data.decode("latin-1")))
def test_an_unreadable_record_counts_as_none(text: str) -> None:
    found = parse_record(text)
    assert found is None or isinstance(found, ConfigRecord)


def test_records_of_other_shapes_count_as_none_or_as_what_can_be_read() -> None:
    for text in (
        "",
        "[]",
        "1",
        '{"absent": 3}',
        '{"absent": ["x"]}',
        '{"rolls": "many"}',
        '{"rolls": 1e999}',
        '{"absent": [Infinity]}',
        "[" * 100_000,
    ):
        assert parse_record(text) is None, text[:20]
    assert parse_record("{}") == ConfigRecord()


def config_map(name: str, **data: str) -> dict[str, ConfigMap]:
    return {f"default/{name}": msgspec.convert({"metadata": {"name": name}, "data": data}, ConfigMap)}


def test_all_places_in_which_a_config_map_is_named_count_with_the_keys_that_they_read() -> None:
    driver = component(
        "driver",
        env=[{"name": "A", "valueFrom": {"configMapKeyRef": {"name": "env", "key": "a"}}}],
        envFrom=[{"configMapRef": {"name": "all"}}],
        parameters=[{"configMapKeyRef": {"name": "files", "key": "$(ROBOTAPP_ROBOT).yaml"}}],
        args=["run"],
        template={
            "spec": {
                "volumes": [
                    {"name": "v", "configMap": {"name": "vol-$(ROBOTAPP_ROBOT)"}},
                    {
                        "name": "p",
                        "projected": {
                            "sources": [{"configMap": {"name": "proj", "items": [{"key": "k", "path": "k"}]}}]
                        },
                    },
                    {"name": "ca", "configMap": {"name": "kube-root-ca.crt"}},
                ],
                "initContainers": [{"name": "i", "image": "i", "envFrom": [{"configMapRef": {"name": "init"}}]}],
            }
        },
    )
    app = make_app(driver)
    names = {"env", "all", "files", "vol-amr-1", "proj", "init"}
    assert list_config_maps(app, "amr-1") == {f"default/{name}" for name in names}
    maps = {key: item for name in names for key, item in config_map(name, a="1", k="1", **{"amr-1.yaml": "1"}).items()}

    def read(maps: dict[str, ConfigMap]) -> ConfigContent:
        return config_content(app.spec.components[0], app, "amr-1", ClusterConfig(maps, {}))

    before = read(maps)
    assert set(before.mounted) == {f"ConfigMap {name}" for name in names - {"files"}}
    assert set(before.files) == {"ConfigMap files"}
    unread = read(maps | config_map("env", a="1", k="2") | config_map("proj", a="2", k="1"))
    assert before.changed_since(unread.mounted, unread.files) == []
    other = read(maps | config_map("env", a="2") | config_map("all", a="1", k="2"))
    assert before.changed_since(other.mounted, other.files) == ["ConfigMap all", "ConfigMap env"]


def test_what_no_container_mounts_is_not_missing_because_the_kubelet_leaves_it_out() -> None:
    volumes = [
        {"name": "idle", "configMap": {"name": "idle"}},
        {"name": "vault", "secret": {"secretName": "vault"}},
        {"name": "files", "configMap": {"name": "files"}},
        {"name": "keys", "secret": {"secretName": "keys"}},
    ]
    step = {"name": "prepare", "image": "x", "volumeMounts": [{"name": "keys", "mountPath": "/keys"}]}
    driver = component(
        "driver",
        volumeMounts=[{"name": "files", "mountPath": "/files"}],
        template={"spec": {"volumes": volumes, "initContainers": [step]}},
    )
    app = make_app(driver)
    content = config_content(app.spec.components[0], app, "", ClusterConfig({}, {"default": {}}))
    assert content.missing == ("there is no ConfigMap files", "there is no Secret keys")
    assert {"ConfigMap idle", "Secret vault"} <= content.mounted.keys(), (
        "what a component refers to is recorded as before"
    )


def test_what_is_required_and_missing_is_named_and_what_is_optional_is_not() -> None:
    driver = component(
        "driver",
        env=[{"name": "A", "valueFrom": {"configMapKeyRef": {"name": "env", "key": "a"}}}],
        envFrom=[{"configMapRef": {"name": "absent"}}, {"configMapRef": {"name": "maybe", "optional": True}}],
    )
    app = make_app(driver)
    found = config_content(app.spec.components[0], app, "", ClusterConfig(config_map("env", b="1"), {}))
    assert found.missing == ("ConfigMap env has no key a", "there is no ConfigMap absent")


def test_secrets_are_named_as_missing_only_where_their_versions_may_be_read() -> None:
    app = make_app(component("driver", envFrom=[{"secretRef": {"name": "s"}}]))
    (driver,) = app.spec.components
    assert reads_config(app)
    assert not config_content(driver, app, "", ClusterConfig({}, {}))
    assert config_content(driver, app, "", ClusterConfig({}, {"default": {}})).missing == ("there is no Secret s",)
    one, other = (config_content(driver, app, "", ClusterConfig({}, {"default": {"s": version}})) for version in "12")
    assert one.changed_since(other.mounted, other.files) == ["Secret s"]
