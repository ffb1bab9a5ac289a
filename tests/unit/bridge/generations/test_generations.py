"""Which generation a file is, and what is read from files with jobs."""

import pytest
from tests.support.rigel.jobfiles import G3, with_block
from tests.support.rigel.rigelfiles import ONE, TWO, orchestration, refusal, rendered, rendered_all, spec

from rigel_bridge.document.tree import parse
from rigel_bridge.generations.detect import detect
from rigel_bridge.generations.load import load
from rigel_bridge.generations.model import Options

G2A = """\
vars: {tag: "3"}
distro: noetic
packages:
  arm:
    jobs:
      build: [{plugin: rigel.plugins.core.BuildXPlugin, with: {image: "acme/arm:{{ tag }}", push: true}}]
      deploy: [{plugin: rigel_bridge.RobotAppPlugin, with: {orchestration: {}}}]
sequences:
  demo: [build, deploy]
"""
G2B = """\
vars: {distro: melodic}
applications:
  arm:
    distro: "{{ distro }}"
    jobs:
      deploy: {plugin: rigel_bridge.RobotAppPlugin, with: {image: "acme/arm:3", orchestration: {}}}
sequences:
  demo: [deploy]
"""
THESIS = """\
application:
  distro: humble
orchestration:
  deploy_ros_master: false
  application_image: acme/teleop:1
  scheduler: {name: kubernetes-scheduler, policies: {latency_budget: 30ms}}
sequences:
  benchmark_default:
    - build: { scheduler_name: default-scheduler }
    - deploy
"""


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (ONE, ("g1", "packages in line 1 is a list")),
        (G2A, ("g2a", "packages in line 3 is a mapping")),
        ("distro: noetic\njobs: {}\n", ("g2a", "distro in line 1 is there")),
        (G2B, ("g2b", "applications in line 2 is a mapping")),
        (G3, ("g3", "application in line 2 is a mapping")),
        (THESIS, ("thesis", "orchestration in line 3 is a mapping")),
    ],
)
def test_the_generation_is_found_with_its_evidence(text: str, expected: tuple[str, str]) -> None:
    assert detect(parse(text.encode(), "Rigelfile")) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("packages: []\njobs: {}\n", "Rigelfile:2: jobs: belongs to another generation than the list of packages"),
        ("packages: 5\n", "expected a list of packages, found a number (5)"),
        ("aplication: {}\n", "found aplication (did you mean application?)"),
        (G3 + "sequence: {}\n", "sequence: is not known in a Rigelfile of generation g3 (did you mean sequences?)"),
        (
            G3.replace("plugin: rigel_bridge", "plugn: rigel_bridge"),
            "jobs.deploy.plugn: is not known here (did you mean plugin?)",
        ),
        (G3.replace("    with:\n      orch", "    wiht:\n      orch"), "(did you mean with?)"),
        (with_block("{schedulr: {}}"), "(did you mean scheduler?)"),
        (
            G3.replace('distro: "{{ vars.distro }}"', "distroo: x"),
            "application.distroo: is not known here (did you mean distro?)",
        ),
        ("application: {distro: humble}\njobs: {}\n", "no job has an orchestration block"),
        (G3.replace('image: "acme/detector:2.1.0", ', ""), "jobs.build.with.image: {{ vars.image }} is not in vars"),
        (with_block("{}").replace("rigel.plugins.core.BuildXPlugin", "x.Y"), "names no image: write application_image"),
        (
            with_block("{}").replace('application: {distro: "{{ vars.distro }}"}', "application: {}"),
            "names its ROS distro",
        ),
        (
            G3.replace("    with:\n      orchestration:", "    with:\n      scheduler_nam: x\n      orchestration:"),
            "(did you mean scheduler_name?)",
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_place(text: str, message: str) -> None:
    found = refusal(text)
    assert message in found
    assert found.startswith("Rigelfile:")


def test_a_mapping_of_packages_beside_an_application_is_the_key_too_many() -> None:
    text = refusal(f"{G3}packages: {{a: {{dir: b}}}}\n")
    assert "packages: is not known in a Rigelfile of generation g3" in text


def test_the_mark_that_rigel_init_writes_is_told_as_such() -> None:
    assert "'$ros_distro' is a mark of `rigel init`" in refusal(ONE.replace("humble", "$ros_distro"))


def test_a_deploying_job_takes_image_command_and_environment_from_the_jobs_before_it() -> None:
    found = spec(G3)
    assert found["components"] == [
        {
            "name": "ros-app",
            "image": "acme/detector:2.1.0",
            "args": ["ros2", "launch", "detector", "detect.launch.py"],
            "env": [{"name": "LEVEL", "value": "1"}],
            "qosClass": "sensor_data",
        }
    ]
    assert found["ros"] == {"distro": "humble"}
    assert found["ros2"] == {"rmw": "rmw_cyclonedds_cpp"}


def test_another_image_does_not_run_the_built_ones_command() -> None:
    (component,) = spec(with_block("{application_image: 'other/x:1'}"))["components"]
    assert component == {"name": "ros-app", "image": "other/x:1"}


def test_components_of_the_block_are_the_components_of_the_app_and_share_the_built_image() -> None:
    block = "{components: {camera: {runsOn: [Robot], args: [ros2, run, c, c]}, the_detector: {}}}"
    camera, detector = spec(with_block(block))["components"]
    shared = {"image": "acme/detector:2.1.0", "env": [{"name": "LEVEL", "value": "1"}]}
    assert camera == {"name": "camera", **shared, "args": ["ros2", "run", "c", "c"], "runsOn": ["Robot"]}
    assert detector == {"name": "the-detector", **shared, "args": ["ros2", "launch", "detector", "detect.launch.py"]}


def test_a_component_with_an_image_of_its_own_has_nothing_of_the_built_one() -> None:
    _, panel = spec(with_block("{components: {detector: {}, panel: {image: 'acme/ui:{{ vars.gpu }}'}}}"))["components"]
    assert panel == {"name": "panel", "image": "acme/ui:1"}


def test_a_benchmark_of_the_default_scheduler_leaves_out_the_wishes_of_single_components_as_well() -> None:
    block = "{components: {camera: {scheduler: {policies: {qos_class: realtime}}}, detector: {}}}"
    (wished,) = {part.get("qosClass") for part in spec(with_block(block))["components"]} - {None}
    plain = spec(with_block(block), sequence="benchmark_default")["components"]
    assert (wished, [part.get("qosClass") for part in plain]) == ("realtime", [None, None])


@pytest.mark.parametrize("where", ["image", "option"])
def test_one_image_beside_or_above_the_components_is_that_of_all(where: str) -> None:
    block = "{application_image: 'other/x:1', components: {camera: {}, detector: {}}}"
    components = spec(with_block(block), image="third/x:1" if where == "option" else "")["components"]
    expected = "third/x:1" if where == "option" else "other/x:1"
    assert [component["image"] for component in components] == [expected, expected]


def test_what_is_one_for_a_file_with_several_components_is_refused_with_its_place_in_them() -> None:
    text = refusal(with_block("{readiness: {command: 'true'}, components: {camera: {}, detector: {}}}"))
    assert "there are several components: write it under components.<name> (readinessProbe)" in text


def test_two_components_of_one_name_are_refused() -> None:
    text = refusal(with_block("{components: {a_b: {}, a-b: {}}}"))
    assert "package a-b becomes component a-b, which another package already is" in text


def test_an_end_of_a_topic_that_is_no_component_is_named_with_the_nearest() -> None:
    block = "{components: {camera: {}, detector: {}}, robotapp: {edges: [{topic: /t, from: camra, to: detector}]}}"
    text = refusal(with_block(block))
    assert "'camra' is no component (did you mean camera?)" in text


@pytest.mark.parametrize(
    ("settings", "image"),
    [
        ("image: 'a/b:1', tags: [9]", "a/b:1"),
        ("image: a/b, tags: ['9', '8']", "a/b:9"),
        ("image: 'localhost:5000/b', tags: ['9']", "localhost:5000/b:9"),
        ("image: 'a/b@sha256:00'", "a/b@sha256:00"),
        ("image: a/b", "a/b:latest"),
    ],
)
def test_the_tag_is_the_references_own_else_the_first_else_latest(settings: str, image: str) -> None:
    text = with_block("{}").replace('image: "{{ vars.image }}"', settings)
    assert spec(text)["components"][0]["image"] == image


def test_an_image_that_no_node_can_pull_is_noted() -> None:
    notes = rendered(with_block("{}").replace('"{{ vars.image }}", push: true', "a/b, load: true")).notes
    assert "a/b:latest: latest is another image tomorrow" in notes[0]
    assert "loaded and not pushed" in notes[1]


@pytest.mark.parametrize(
    ("sequence", "scheduler"),
    [("demo", "kubernetes-scheduler"), ("benchmark_default", "default-scheduler"), ("arguments", "lab")],
)
def test_a_sequence_chooses_the_scheduler(sequence: str, scheduler: str) -> None:
    assert spec(G3, sequence=sequence)["schedulerName"] == scheduler


def test_kube_schedulers_own_takes_no_wishes_with_it() -> None:
    assert "qosClass" in spec(G3, sequence="demo")["components"][0]
    assert "qosClass" not in spec(G3, sequence="benchmark_default")["components"][0]


def test_an_override_replaces_the_block_as_rigel_does() -> None:
    text = G3.replace(
        "deploy, with: {scheduler_name: default-scheduler}", "deploy, with: {orchestration: {name: other}}"
    )
    found = rendered(text, sequence="benchmark_default")
    assert found.app["metadata"]["name"] == "other"
    assert "schedulerName" not in found.app["spec"]


def test_a_matrix_is_one_app_per_combination_with_a_stable_name() -> None:
    names = [one.app["metadata"]["name"] for one in rendered_all(G3, sequence="sweep")]
    assert names == [one.app["metadata"]["name"] for one in rendered_all(G3, sequence="sweep")]
    assert len(set(names)) == 2
    assert names[0].startswith("detector-1-a-")


def test_data_of_a_matrix_reaches_the_block() -> None:
    text = with_block("{name: detector, components: {ros-app: {env: [{name: S, value: '{{ data.name }}'}]}}}")
    assert rendered_all(text, sequence="sweep")[0].app["spec"]["components"][0]["env"] == [{"name": "S", "value": "a"}]
    assert "is known only while Rigel runs" in refusal(text)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sequence": "dmo"}, "there is no sequence dmo (did you mean demo?); sequences: demo, benchmark_default"),
        ({"sequence": "without"}, "sequence without has no job with an orchestration block"),
        ({"job": "deplo"}, "no job deplo deploys (did you mean deploy?); jobs with an orchestration block: deploy"),
    ],
)
def test_a_choice_that_is_not_there_is_named(options: dict[str, str], message: str) -> None:
    assert message in refusal(G3, **options)


def test_of_several_deploying_jobs_the_first_is_taken_and_said() -> None:
    second = "  other: {plugin: src.plugin.OrchestrationPlugin, with: {orchestration: {name: b}}}\n"
    text = G3.replace("sequences:", second + "sequences:")
    rigelfile = load(parse(text.encode(), "Rigelfile"), Options())
    assert rigelfile.jobs == ("deploy", "other")
    assert rigelfile.notes[-1].endswith("job deploy is taken; --job chooses another: other")
    assert rendered(text, job="other").app["metadata"]["name"] == "b"


def test_the_drafts_between_the_generations_are_read_by_their_own_template_rules() -> None:
    assert spec(G2A, sequence="demo")["components"][0]["image"] == "acme/arm:3"
    assert spec(G2A)["ros"] == {"distro": "noetic"}
    assert spec(G2B, sequence="demo")["ros"] == {"distro": "melodic"}
    message = refusal(G2A.replace("{{ tag }}", "{{ HOME }}"), environment={"HOME": "/x"})
    assert message.endswith("{{ HOME }} is not in vars")


def test_a_block_at_the_top_needs_no_job() -> None:
    assert spec(THESIS)["schedulerName"] == "kubernetes-scheduler"
    assert spec(THESIS, sequence="benchmark_default") == {
        "ros": {"distro": "humble"},
        "components": [{"name": "ros-app", "image": "acme/teleop:1"}],
        "schedulerName": "default-scheduler",
    }
    assert spec(THESIS, sequence="benchmark_default") == spec(
        THESIS.replace("- deploy", "- deploy:"), sequence="benchmark_default"
    )


def test_a_block_at_the_top_and_in_a_job_are_one_too_many() -> None:
    assert "orchestration is already in line 1: keep one" in refusal("orchestration: {name: a}\n" + G3)


def test_a_first_generation_file_hands_its_sequences_to_the_plugin() -> None:
    text = orchestration("scheduler: {name: a}") + (
        "      sequences: {benchmark_default: [{build: {scheduler_name: default-scheduler}}, deploy]}\n"
    )
    assert spec(text)["schedulerName"] == "a"
    assert spec(text, sequence="benchmark_default")["schedulerName"] == "default-scheduler"
    assert "sequences: benchmark_default" in refusal(text, sequence="demo")
    assert "Rigel 0.2 has two: build, deploy" in refusal(text.replace(", deploy]", ", deplo]"))
    assert "is not known here (did you mean sequences?)" in refusal(text.replace("sequences:", "sequences_:"))


def test_a_missing_name_can_be_given() -> None:
    text = "orchestration: {scheduler: {policies: {deadline: 50ms}}}\n"
    found = spec(text, image="acme/x:1", distro="jazzy")
    assert (found["ros"], found["components"][0]["image"]) == ({"distro": "jazzy"}, "acme/x:1")


@pytest.mark.parametrize(
    ("sequence", "message"),
    [
        ("{stages: [{job: [a]}]}", "is not known here (did you mean jobs?)"),
        ("{stages: [{matrix: {a: [1]}, jobs: [deploy]}]}", "belongs to a stage with parallel"),
        ("{stages: [{matrix: {a: []}, parallel: [{jobs: [deploy]}]}]}", "needs at least one value"),
        (
            "{stages: [{matrix: {a: &x [1,2,3,4,5], b: [1,2,3,4,5], c: [1,2,3]}, parallel: [{jobs: [deploy]}]}]}",
            "more than 64 combinations",
        ),
        ("{stages: [{jobs: [deploi]}]}", "there is no job deploi (did you mean deploy?)"),
        ("{stagez: []}", "(did you mean stages?)"),
        ("{}", "stages is missing"),
        ("[{build: {}, deploy: {}}]", "expected a job, or one job with its overrides"),
    ],
)
def test_an_unsound_sequence_is_refused(sequence: str, message: str) -> None:
    assert message in refusal(with_block("{}") + f"  bad: {sequence}\n", sequence="bad")


def test_what_stands_beside_the_block_of_a_first_generation_file_holds_too() -> None:
    text = orchestration("scheduler: {}") + "      image: other/x:2\n      name: other\n      namespace: lab\n"
    found = rendered(text)
    assert (found.app["metadata"]["name"], found.app["spec"]["components"][0]["image"]) == ("other", "other/x:2")
    assert found.notes[0].endswith(
        "kwargs.namespace is not carried over: the command line names the namespace (-n), not the file"
    )
    assert "leave out the one image (--image" in refusal(TWO, image="x:1")


def test_the_command_lines_image_comes_before_the_steps_the_blocks_and_the_build_jobs() -> None:
    text = with_block("{application_image: 'block/x:1'}").replace(
        "deploy, with: {scheduler_name: default-scheduler}", "deploy, with: {image: 'step/x:1'}"
    )
    images = [
        spec(text, **options)["components"][0]["image"]
        for options in ({"image": "flag/x:1", "sequence": "benchmark_default"}, {"sequence": "benchmark_default"}, {})
    ]
    assert images == ["flag/x:1", "step/x:1", "block/x:1"]


def test_a_steps_override_of_the_build_job_is_what_is_deployed() -> None:
    text = G3.replace("build, with: {buildargs: {scheduler_name: lab}}", "build, with: {image: 'a/b:step'}")
    assert spec(text, sequence="arguments")["components"][0]["image"] == "a/b:step"


def test_a_build_job_that_cannot_be_read_matters_only_when_its_image_is_needed() -> None:
    text = with_block("{application_image: 'block/x:1'}").replace("{{ vars.image }}", "{{ vars.REGISTRY }}/x")
    assert spec(text)["components"][0]["image"] == "block/x:1"


def test_an_override_of_a_build_that_is_not_there_is_not_dropped() -> None:
    text = THESIS.replace("{ scheduler_name: default-scheduler }", "{ image: a }")
    assert "image: is not known here" in refusal(text, sequence="benchmark_default")
