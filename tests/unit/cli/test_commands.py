"""list, domains, devices, render: tables, structured output, errors and exit codes."""

import json
from typing import Any

import pytest
import yaml
from tests.unit.cli.running import ROBOTAPPS, STATUS, SUMMARY, UID, Stage, robotapp

from robotapp_claims.rules.identity import device_label


def claim(name: str, *, namespace: str = "fleet", phase: str = "Reserved", **thing: Any) -> dict[str, Any]:
    holder = {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "RobotApp",
        "namespace": namespace,
        "name": "teleop",
        "uid": UID,
        "instance": "amr-07",
        "component": "driver",
    }
    return {"metadata": {"name": name}, "spec": {**thing, "holder": holder}, "status": {"phase": phase}}


class TestList:
    def test_shows_the_columns_of_kubectl_get(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS), robotapp("other", namespace="elsewhere"))
        heading, row = stage.text("list").splitlines()
        assert heading.split() == ["NAME", "READY", "PHASE", "DOMAIN", "ROBOTS", "BUDGET", "DEVICES", "AGE"]
        assert row.split()[:-1] == ["teleop", "2/2", "Running", "7", "1/1", "18/30ms", "1/1"]

    def test_all_namespaces_and_wide(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS), robotapp("other", namespace="elsewhere"))
        lines = stage.text("list", "-A", "-o", "wide").splitlines()
        assert lines[0].split()[0] == "NAMESPACE"
        assert [line.split()[:2] for line in lines[1:]] == [["elsewhere", "other"], ["fleet", "teleop"]]
        assert "rmw_fastrtps_cpp" in lines[2]

    def test_an_empty_namespace_says_what_to_try(self, stage: Stage) -> None:
        assert "No RobotApp in namespace nowhere" in stage.text("list", "-n", "nowhere")

    @pytest.mark.parametrize(("output", "load"), [("json", json.loads), ("yaml", yaml.safe_load)])
    def test_structured_output_is_the_objects(self, stage: Stage, output: str, load: Any) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        found = load(stage.text("list", "-o", output))
        assert (found["kind"], found["items"][0]["status"]["summary"]) == ("List", SUMMARY)

    @pytest.mark.parametrize("command", [["list"], ["info", "teleop"], ["domains"]])
    def test_structured_output_leaves_out_who_wrote_which_field_as_kubectl_does(
        self, stage: Stage, command: list[str]
    ) -> None:
        for resource, obj in (
            (ROBOTAPPS, robotapp(status=STATUS)),
            ("robotics.io/domainpools", {"metadata": {"name": "default"}}),
        ):
            obj["metadata"]["managedFields"] = [{"manager": "helm"}]
            stage.add(resource, obj)
        text = stage.text(*command, "-o", "json")
        assert '"name": "default"' in text or '"name": "teleop"' in text
        assert "managedFields" not in text

    def test_nothing_is_coloured_outside_a_terminal(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        assert "\x1b" not in stage.text("list") + stage.text("info", "teleop")


POOL = {"metadata": {"name": "default"}, "spec": {"scope": "Cluster", "ids": "1-101,215-232"}}


class TestDomains:
    def test_shows_how_full_the_pools_are_and_who_holds_what(self, stage: Stage) -> None:
        stage.add("robotics.io/domainpools", POOL)
        domain = {"pool": "default", "scope": "Cluster", "scopeValue": ""}
        stage.add("robotics.io/robotclaims", claim("dds.default.c.7", domain={**domain, "id": 7}))
        stage.add(
            "robotics.io/robotclaims",
            claim("dds.default.c.12", namespace="b", phase="Draining", domain={**domain, "id": 12}),
        )
        lines = stage.text("domains").splitlines()
        assert lines[1].split() == ["default", "Cluster", "2/119", "1", "1-101,215-232"]
        assert [line.split()[:5] for line in lines[4:]] == [
            ["7", "default", "fleet/teleop", "amr-07", "Reserved"],
            ["12", "default", "b/teleop", "amr-07", "Draining"],
        ]
        assert [item["metadata"]["name"] for item in stage.data("domains", "-n", "b")["claims"]] == ["dds.default.c.12"]
        assert "Namespace c holds no domain." in stage.text("domains", "-n", "c")
        assert "dds.default.c.7" in stage.text("domains", "-o", "wide")


class TestDevices:
    def test_free_held_and_unreported_devices(self, stage: Stage) -> None:
        devices = [
            {"id": "can-can0", "type": "can", "interface": "can0", "present": True},
            {"id": "cam", "type": "usb", "present": False},
        ]
        stage.add("robotics.io/nodetelemetries", {"metadata": {"name": "amr-07"}, "status": {"devices": devices}})
        stage.add("robotics.io/robotclaims", claim("dev.a", device={"node": "amr-07", "id": "can-can0", "type": "can"}))
        stage.add(
            "robotics.io/robotclaims",
            claim("dev.b", namespace="b", device={"node": "gone", "id": "lidar", "type": "usb"}),
        )
        rows = [line.split() for line in stage.text("devices").splitlines()[1:]]
        assert rows[0] == ["amr-07", "cam", "usb", "no", "absent"]
        assert rows[1] == ["amr-07", "can-can0", "can", "can0", "yes", "fleet/teleop", "amr-07", "driver", "Reserved"]
        assert rows[2] == ["gone", "lidar", "usb", "unknown", "b/teleop", "amr-07", "driver", "Reserved"]
        assert [row["device"] for row in stage.data("devices", "-n", "fleet")["devices"]] == ["cam", "can-can0"]

    def test_a_device_of_a_resource_claim_has_its_holder_as_one_of_a_robotclaim(self, stage: Stage) -> None:
        device = {"id": "serial-1", "type": "serial", "present": True}
        stage.add("robotics.io/nodetelemetries", {"metadata": {"name": "amr-07"}, "status": {"devices": [device]}})
        owner = {
            "apiVersion": "robotics.io/v1alpha1",
            "kind": "RobotApp",
            "name": "base",
            "uid": "u",
            "controller": True,
        }
        result = {"request": "d", "driver": "devices.robotics.io", "pool": "amr-07", "device": "serial-1"}
        meta = {"name": "base-x", "namespace": "fleet", "ownerReferences": [owner]}
        meta["labels"] = {"robotics.io/instance": "amr-07", "robotics.io/component": "driver"}
        status = {"allocation": {"devices": {"results": [result, result | {"driver": "gpu.example.org"}]}}}
        stage.add("resource.k8s.io/resourceclaims", {"metadata": meta, "status": status})
        (row,) = stage.data("devices")["devices"]
        assert (row["holder"], row["instance"], row["component"]) == ("fleet/base", "amr-07", "driver")
        assert row["claim"] == "resourceclaim/fleet/base-x/serial-1"

    @pytest.mark.parametrize(
        ("forbidden", "holders"),
        [(("resourceclaims",), ["unknown", "free"]), (("resourceclaims", "resourceslices"), ["unknown", "unknown"])],
    )
    def test_a_device_whose_claims_may_not_be_read_is_not_shown_as_free(
        self, stage: Stage, forbidden: tuple[str, ...], holders: list[str]
    ) -> None:
        for name in ("amr-07", "edge-1"):
            stage.add("/nodes", {"metadata": {"name": name}})
            device = {"id": "serial-1", "type": "serial", "present": True}
            stage.add("robotics.io/nodetelemetries", {"metadata": {"name": name}, "status": {"devices": [device]}})
        spec = {"driver": "devices.robotics.io", "nodeName": "amr-07"}
        stage.add("resource.k8s.io/resourceslices", {"metadata": {"name": "amr-07-x"}, "spec": spec})
        stage.api.forbidden |= {f"/apis/resource.k8s.io/v1/{plural}" for plural in forbidden}
        assert [row["state"] for row in stage.data("devices")["devices"]] == holders
        text = stage.text("devices")
        assert [line.split()[3] for line in text.splitlines()[1:3]] == holders
        assert "robotapp-cluster-viewer" in text

    def test_columns_that_say_nothing_are_left_out_of_the_narrow_form(self, stage: Stage) -> None:
        device = {"id": "cam", "type": "usb", "present": True}
        stage.add("robotics.io/nodetelemetries", {"metadata": {"name": "n"}, "status": {"devices": [device]}})
        narrow, wide = (stage.text("devices", "-o", form).splitlines()[0].split() for form in ("table", "wide"))
        assert narrow == ["NODE", "DEVICE", "TYPE", "HOLDER", "INSTANCE", "COMPONENT", "PHASE"]
        assert {"MODEL", "INTERFACE", "PRESENT", "CLAIM", "PATH"} <= set(wide)

    def test_a_device_whose_id_is_no_label_is_found_under_its_hashed_name(self, stage: Stage) -> None:
        device = {"id": "/dev/ttyUSB0", "type": "serial", "present": True}
        stage.add("robotics.io/nodetelemetries", {"metadata": {"name": "n"}, "status": {"devices": [device]}})
        thing = {"node": "n", "id": device_label("/dev/ttyUSB0"), "type": "serial"}
        stage.add("robotics.io/robotclaims", claim("dev.c", device=thing))
        (row,) = stage.data("devices")["devices"]
        assert (row["device"], row["holder"]) == ("/dev/ttyUSB0", "fleet/teleop")

    def test_no_device_at_all_says_who_would_report_one(self, stage: Stage) -> None:
        assert "reported by the node agents" in stage.text("devices")

    def test_where_no_agent_reports_the_nodes_labels_name_the_devices(self, stage: Stage) -> None:
        labels = {"hardware.robotics.io/can-can0": "true", "hardware.robotics.io/gpu": "nvidia", "zone": "a"}
        stage.add("/nodes", {"metadata": {"name": "amr-07", "labels": labels}})
        stage.add("/nodes", {"metadata": {"name": "amr-08"}})
        stage.add("robotics.io/robotclaims", claim("dev.a", device={"node": "amr-07", "id": "can-can0", "type": "can"}))
        rows = [line.split()[:6] for line in stage.text("devices").splitlines()[1:]]
        assert rows == [
            ["amr-07", "can-can0", "can", "can0", "fleet/teleop", "amr-07"],
            ["amr-07", "gpu", "gpu", "nvidia", "device", "plugin"],
        ]
        assert {row["source"] for row in stage.data("devices")["devices"]} == {"label"}

    def test_a_device_named_by_label_and_agent_is_one_and_keeps_its_holder(self, stage: Stage) -> None:
        """It was claimed when only the label was known, and the agent knows it by its serial number."""
        stage.add("/nodes", {"metadata": {"name": "n", "labels": {"hardware.robotics.io/usb": "d435"}}})
        thing = {"node": "n", "id": "usb", "type": "usb"}
        stage.add("robotics.io/robotclaims", claim("dev.n.usb", device=thing))
        (row,) = stage.data("devices")["devices"]
        assert (row["device"], row["model"], row["source"], row["holder"]) == ("usb", "d435", "label", "fleet/teleop")
        reported = {
            "id": "video-0123",
            "type": "video",
            "identity": "8086:0b3a:0123",
            "names": ["usb"],
            "present": True,
        }
        stage.add("robotics.io/nodetelemetries", {"metadata": {"name": "n"}, "status": {"devices": [reported]}})
        (row,) = stage.data("devices")["devices"]
        assert (row["device"], row["source"], row["claim"]) == ("video-0123", "agent", "dev.n.usb")


class TestRender:
    def test_shows_the_children_without_what_others_added(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp())
        owner = {"uid": UID, "kind": "RobotApp", "name": "teleop", "apiVersion": "robotics.io/v1alpha1"}
        metadata = {
            "name": "d",
            "namespace": "fleet",
            "labels": {"robotics.io/app-uid": UID},
            "uid": "x",
            "managedFields": [],
            "generation": 3,
        }
        annotations = {"deployment.kubernetes.io/revision": "1", "kept": "yes"}
        child = {
            "metadata": {**metadata, "annotations": annotations, "ownerReferences": [owner]},
            "spec": {"replicas": 1},
            "status": {"replicas": 1},
        }
        foreign = {"metadata": {**metadata, "name": "foreign"}, "spec": {}}
        stage.add("apps/deployments", child, foreign)
        (found,) = yaml.safe_load_all(stage.text("render", "teleop"))
        assert (found["kind"], found["spec"], found["metadata"]["annotations"]) == (
            "Deployment",
            {"replicas": 1},
            {"kept": "yes"},
        )
        assert not {"uid", "managedFields", "generation", "resourceVersion", "status"} & {*found, *found["metadata"]}
        assert len(stage.data("render", "teleop")["items"]) == 1

    def test_an_app_without_children_says_where_to_look(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp())
        result = stage.run("render", "teleop")
        assert (result.exit_code, result.stdout) == (0, "")
        assert "kubectl robotapp info teleop says why" in result.stderr

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            ("kind: Pod\nmetadata: {name: x}\n", "holds no RobotApp with a name"),
            ("a: [", "is neither YAML nor JSON"),
            ("kind: RobotApp\nmetadata: {}\n", "holds no RobotApp"),
            ("kind: RobotApp\nmetadata: {name: a b}\n", "metadata.name: 'a b' is not a name"),
            ("kind: RobotApp\nmetadata: {name: a, namespace: b/c}\n", "metadata.namespace: 'b/c' is not a name"),
            ("[" * 100_000 + "]" * 100_000, "is nested deeper than 200 levels"),
            ("a: !!set {b}", "is neither YAML nor JSON"),
            ('{"a": "\\ud800"}', "is neither YAML nor JSON"),
            ("a: " + "1" * 5000, "is neither YAML nor JSON"),
            ('{"kind": "Pod", "a": ' + "[" * 300 + "]" * 300 + "}", "is nested deeper than 200 levels"),
            ("#" * 1_048_577, "is larger than 1 MiB"),
            ("\xff", "is not UTF-8 text"),
        ],
        ids=[
            "pod",
            "yaml",
            "nameless",
            "name",
            "namespace",
            "deep",
            "set",
            "half",
            "digits",
            "deep-json",
            "large",
            "latin-1",
        ],
    )
    def test_a_file_that_holds_no_robotapp_is_refused(self, stage: Stage, content: str, message: str) -> None:
        path = stage.kubeconfig.with_name("app.yaml")
        path.write_bytes(content.encode("latin-1"))
        result = stage.run("render", "-f", str(path))
        assert result.exit_code == 2
        assert message in result.stderr

    def test_a_name_and_a_file_together_or_neither_are_wrong_usage(self, stage: Stage) -> None:
        assert stage.run("render").exit_code == stage.run("render", "x", "-f", "y").exit_code == 2
        assert stage.run("render", "-f", "/nowhere").exit_code == 2


class TestErrors:
    def test_an_unknown_app_is_not_found(self, stage: Stage) -> None:
        result = stage.run("info", "telop")
        assert result.exit_code == 4
        assert result.stderr == 'error: robotapps "telop" not found\nkubectl robotapp list -A shows what there is.\n'

    @pytest.mark.parametrize("name", ["a b", "teleop/status", "", "te%6ceop", "..", "A"])
    def test_what_no_object_can_be_called_never_becomes_a_url(self, stage: Stage, name: str) -> None:
        commands = (
            ["info", "--", name],
            ["explain", "--", name],
            ["render", "--", name],
            ["list", f"--namespace={name}"],
        )
        for command in commands:
            result = stage.run(*command)
            assert result.exit_code == 2
            assert f"{name!r} is not a name" in " ".join(result.stderr.split())

    def test_a_context_whose_namespace_cannot_exist_is_named(self, stage: Stage) -> None:
        stage.kubeconfig.write_text(stage.kubeconfig.read_text().replace("namespace: fleet", "namespace: a b"))
        result = stage.run("list")
        assert result.exit_code == 1
        assert "names the namespace 'a b'" in result.stderr

    def test_a_missing_kubeconfig_names_the_option(self, stage: Stage) -> None:
        result = stage.run("list", KUBECONFIG="/nowhere/config")
        assert result.exit_code == 3
        assert "--kubeconfig" in result.stderr

    def test_an_unknown_context_is_said_with_the_file(self, stage: Stage) -> None:
        result = stage.run("list", "--context", "prod")
        assert result.exit_code == 3
        assert "prod" in result.stderr

    def test_a_server_that_is_gone_is_unreachable(self, stage: Stage) -> None:
        stage.kubeconfig.write_text(
            stage.kubeconfig.read_text().replace(stage.api.endpoint.server, "http://127.0.0.1:1")
        )
        result = stage.run("list")
        assert result.exit_code == 3
        assert "the API server cannot be reached" in result.stderr

    @pytest.mark.parametrize(
        ("status", "code", "text"),
        [(403, 1, "robotapp-cluster-viewer"), (401, 3, "does not know you"), (400, 1, "error: ")],
    )
    def test_refusals_say_what_to_ask_for(self, stage: Stage, status: int, code: int, text: str) -> None:
        stage.api.failing.extend([status] * 3)
        result = stage.run("domains")
        assert result.exit_code == code
        assert text in result.stderr
        assert "Traceback" not in result.output

    @pytest.mark.parametrize("arguments", [["nope"], ["list", "--nope"], ["list", "-o", "xml"], ["info"]])
    def test_wrong_usage_has_code_2(self, stage: Stage, arguments: list[str]) -> None:
        assert stage.run(*arguments).exit_code == 2

    @pytest.mark.parametrize(
        "command", ["list", "info", "explain", "simulate", "domains", "devices", "nodes", "robots", "render", "lint"]
    )
    def test_every_command_has_help_with_an_example(self, stage: Stage, command: str) -> None:
        assert f"kubectl robotapp {command}" in stage.text(command, "--help")

    def test_the_exit_codes_are_in_the_help(self, stage: Stage) -> None:
        assert "Exit codes: 0 done; 1 refused" in stage.text("--help")
