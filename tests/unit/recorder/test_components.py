"""The component that a recording becomes, and what is wrong with recordings."""

from typing import Any

import pytest
from tests.support.factories import app_body, component

from robotapp_api.checks.spec import spec_notes, spec_problems
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.values.recordings.components import add_recorders, folder_of
from robotapp_operator.plan.spec.record import parse_record
from robotapp_recorder.settings import read_settings

ALL = {"name": "all", "topics": {"regex": ".*", "exclude": "/rosout"}}


def make_spec(*recordings: dict[str, Any], distro: str = "jazzy", parts: Any = None) -> RobotAppSpec:
    parts = parts or [component("driver"), component("planner")]
    body = {"ros": {"distro": distro}, "components": parts, "recordings": list(recordings)}
    return RobotAppSpec.model_validate(body)


def problems_of(*recordings: dict[str, Any], **spec: Any) -> list[str]:
    return [str(problem) for problem in spec_problems(make_spec(*recordings, **spec))]


def test_a_spec_without_recordings_stays_the_same_object() -> None:
    spec = make_spec()
    assert add_recorders(spec) is spec


def test_its_arguments_are_those_that_the_recorder_reads() -> None:
    recording = {
        "name": "drive",
        "topics": {"names": ["/scan", "/odom"], "regex": "/camera/.*"},
        "split": {"size": "64Mi", "duration": "10m"},
        "retain": {"size": "1Gi"},
    }
    recorder = add_recorders(make_spec(recording)).components[-1]
    assert recorder.args[:4] == ("python3", "-m", "robotapp_recorder", "record")
    settings = read_settings(recorder.args[4:])
    assert settings.selection.names == {"/scan", "/odom"}
    assert settings.selection.regex == "/camera/.*"
    assert (settings.limits.split_bytes, settings.limits.retain_bytes) == (64 << 20, 1 << 30)
    assert settings.limits.split_ns == 600 * 10**9
    assert str(settings.folder) == "/bags/$(ROBOTAPP_APP)/$(ROBOTAPP_INSTANCE)/drive"


def test_what_the_kubelet_would_take_for_a_variable_stays_text() -> None:
    recorder = add_recorders(make_spec({"name": "a", "topics": {"regex": "/a$(b)?"}})).components[-1]
    assert "--regex=/a$$(b)?" in recorder.args


def test_bags_of_each_instance_have_a_folder_of_their_own() -> None:
    assert folder_of("app", "amr-07", "drive") == "/bags/app/amr-07/drive"
    assert folder_of("app", "", "drive") == "/bags/app/drive"


def test_its_image_is_that_of_the_distribution_unless_it_writes_one() -> None:
    assert add_recorders(make_spec(ALL), image="r/rec:1-{distro}").components[-1].image == "r/rec:1-jazzy"
    assert add_recorders(make_spec(ALL | {"image": "my/app:1"})).components[-1].image == "my/app:1"


def test_its_volume_is_bounded_or_the_claim_beside_which_it_runs() -> None:
    recorder = add_recorders(make_spec(ALL)).components[-1]
    assert recorder.template.spec.volumes[0]["emptyDir"] == {"sizeLimit": str((5 << 30) + (256 << 20))}
    recorder = add_recorders(make_spec(ALL | {"volume": {"claimName": "bags"}})).components[-1]
    assert recorder.template.spec.volumes[0]["persistentVolumeClaim"] == {"claimName": "bags"}
    assert recorder.shared_data is not None
    assert recorder.shared_data.claim_names == ("bags",)


def test_its_pod_follows_what_the_components_have_alike() -> None:
    tolerations = [{"key": "robot", "operator": "Exists"}]
    pod = {"tolerations": tolerations, "imagePullSecrets": [{"name": "regcred"}], "priorityClassName": "robots"}
    metadata = {"labels": {"team": "a"}}
    parts = [
        component("driver", template={"metadata": metadata, "spec": pod}),
        component("planner", template={"metadata": {"labels": {"team": "a", "x": "y"}}, "spec": pod}),
    ]
    template = add_recorders(make_spec(ALL, parts=parts)).components[-1].template
    assert template.metadata.labels == {"team": "a"}
    assert [dict(each) for each in template.spec.tolerations] == tolerations
    assert template.spec.priority_class_name == "robots"
    assert [dict(each) for each in template.spec.image_pull_secrets] == [{"name": "regcred"}]


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"topics": {"regex": "("}}, "spec.recordings[0].topics.regex: ( is no regular expression"),
        ({"split": {"size": "1Ki"}}, "write at least 1Mi"),
        ({"retain": {"size": "300Mi"}}, "write at least twice split.size"),
        ({"split": {"duration": "0s"}}, "spec.recordings[0].split.duration: 0s would begin a bag with every message"),
        ({"split": {"duration": "999999h999999h999999h"}}, "is longer than any recording; write for example 10m"),
    ],
)
def test_what_is_wrong_is_named_with_its_place_and_cure(changes: dict[str, Any], error: str) -> None:
    (problem,) = problems_of(ALL | changes)
    assert error in problem


def test_recordings_are_for_ros_2() -> None:
    (problem,) = problems_of(ALL, distro="noetic")
    assert "write a component that runs rosbag record" in problem


def test_bags_that_go_with_their_pod_are_noted() -> None:
    notes = [str(note) for note in spec_notes(make_spec(ALL))]
    assert any(note.startswith("spec.recordings[0].volume: is not written") for note in notes)
    assert not any("recordings" in str(note) for note in spec_notes(make_spec(ALL | {"volume": {"claimName": "b"}})))


def test_a_changed_recording_changes_no_other_component() -> None:
    """So no component rolls because of it."""
    first, second = (
        parse_record(app_body(ros={"distro": "jazzy"}, recordings=[recording])).app
        for recording in (ALL, ALL | {"retain": {"size": "9Gi"}})
    )
    assert first is not None
    assert second is not None
    changed = {name for name, text in first.spec_hashes.items() if second.spec_hashes[name] != text}
    assert changed == {"all", ""}, "and the hash of the whole instance"
