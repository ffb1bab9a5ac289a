"""nodes and robots: what is shown of each, how old it is, and that the table stays within a terminal."""

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from rich.cells import cell_len
from tests.unit.cli.running import Stage

Json = dict[str, Any]
TELEMETRY = "robotics.io/nodetelemetries"


def ago(seconds: float) -> str:
    return (datetime.now(UTC) - timedelta(seconds=seconds)).strftime("%Y-%m-%dT%H:%M:%SZ")


def node(name: str, *, ready: bool = True, since_s: float = 7000, **labels: str) -> Json:
    known = {
        "zone": "topology.kubernetes.io/zone",
        "primary": "robotics.io/robot-primary",
        "can": "hardware.robotics.io/can-can0",
    }
    full = {known.get(key, f"robotics.io/{key}"): value for key, value in labels.items()}
    heard = {"type": "Ready", "status": "True" if ready else "Unknown", "lastTransitionTime": ago(since_s)}
    return {"metadata": {"name": name, "labels": full}, "status": {"conditions": [heard]}}


def report(name: str, *, written_s: float = 4, **status: Any) -> Json:
    """`written_s`: seconds since the agent wrote; the operator wrote its part just now."""
    fields = [
        {"manager": "robotapp-operator", "time": ago(0)},
        {"manager": "robotapp-agent", "subresource": "status", "time": ago(written_s)},
        {"manager": "robotapp-agent", "subresource": "status", "time": ago(written_s + 900)},
    ]
    return {"metadata": {"name": name, "managedFields": fields}, "status": {"intervalSeconds": 10, **status}}


def rtt(**p95_ms: float | None) -> list[Json]:
    """None: no probe was answered."""
    return [
        {
            "peer": peer.replace("_", "-"),
            **({"lossPPM": 1_000_000} if ms is None else {"p50Us": 1, "p95Us": int(ms * 1000)}),
        }
        for peer, ms in p95_ms.items()
    ]


def rows(stage: Stage, command: str) -> list[list[str]]:
    return [line.split() for line in stage.text(command).splitlines()]


def held(name: str, device: str) -> Json:
    holder = {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "RobotApp",
        "namespace": "fleet",
        "name": "teleop",
        "uid": "u",
    }
    thing = {"node": name, "id": device, "type": device.split("-", maxsplit=1)[0]}
    return {"metadata": {"name": f"dev.{name}.{device}"}, "spec": {"device": thing, "holder": holder}}


def test_a_node_with_all_there_is_to_say(stage: Stage) -> None:
    stage.add("/nodes", node("edge-1", tier="edge", zone="hall"), node("edge-2", tier="edge", zone="hall"))
    devices = [{"id": f"usb-{i}", "type": "usb", "present": i < 2} for i in range(3)]
    load = {"cpuPercent": 12, "memoryPercent": 48}
    stage.add(TELEMETRY, report("edge-1", rtt=rtt(edge_2=0.8, far=90), devices=devices, load=load))
    stage.add("robotics.io/robotclaims", held("edge-1", "usb-1"))
    heading, first, second = rows(stage, "nodes")
    assert heading == ["NODE", "TIER", "ZONE", "RTT", "P95", "FREE/HELD", "CPU/MEM", "AGENT"]
    assert first[:6] == ["edge-1", "edge", "hall", "0.8ms", "1/1", "12/48%"]
    assert first[6] in {"4s", "5s", "6s"}
    assert second == ["edge-2", "edge", "hall", "0.8ms"]


def test_wide_has_everything_that_the_agent_reports(stage: Stage) -> None:
    stage.add("/nodes", node("amr", zone="z"), node("edge-1", zone="z"), node("edge-2", zone="z"))
    full = {
        "arch": "arm64",
        "kernel": {"realtime": True},
        "load": {"cpuPercent": 1, "memoryPercent": 2, "diskPercent": 40, "networkBps": 2_340_000},
        "temperatures": [{"name": "cpu-thermal", "celsius": 71}, {"name": "nvme", "celsius": 38}],
        "battery": {"percent": 80, "charging": True},
        "clock": {"offsetMilliseconds": -120},
        "rtt": [entry | {"jitterUs": 200} for entry in rtt(edge_1=0.8)],
        "deviceProblem": "rules.yaml:3: unknown key [usbid]",
    }
    stage.add(TELEMETRY, report("amr", **full), report("edge-1", written_s=400, **full))
    heading, first, second, third, *problems = stage.text("nodes", "-o", "wide").splitlines()
    assert heading.split()[-7:] == ["JITTER", "DISK/GPU", "NET", "TEMP", "BATTERY", "CLOCK", "ARCH"]
    assert first.split()[-9:] == [
        "0.2ms",
        "40/-%",
        "2.3Mbit/s",
        "71C",
        "80%",
        "charging",
        "-120ms",
        "arm64",
        "realtime",
    ]
    assert second.split()[-2:] == ["arm64", "realtime"]
    assert "80%" not in second, "its agent is silent"
    assert third.split()[0] == "edge-2"
    assert problems == [f"node {name}: rules.yaml:3: unknown key [usbid]" for name in ("amr", "edge-1")]
    (shown, *_) = stage.data("nodes")["nodes"]
    assert shown["temperatures"] == {"cpu-thermal": 71, "nvme": 38}
    assert (shown["battery"], shown["clockOffsetMilliseconds"]) == ({"percent": 80, "charging": True}, -120)
    assert (shown["load"]["networkBps"], shown["arch"], shown["jitter"]) == (2_340_000, "arm64", "0.2ms")
    assert "ARCH" not in stage.text("nodes")


def test_a_robot_alone_in_its_zone_shows_the_way_to_the_nearest_one(stage: Stage) -> None:
    zones = {"cloud": "cloud", "hall": "hall", "amr": "floor"}
    stage.add("/nodes", *(node(name, zone=zone) for name, zone in zones.items()))
    stage.add(TELEMETRY, report("amr", rtt=rtt(cloud=60, hall=12)))
    (row,) = [row for row in stage.data("nodes")["nodes"] if row["node"] == "amr"]
    assert (row["rttP95"], row["rttZone"]) == ("12ms", "hall")
    assert rows(stage, "nodes")[1][2:4] == ["12ms", "hall"]


def test_a_node_that_nobody_reaches_says_so(stage: Stage) -> None:
    stage.add("/nodes", *(node(name, zone="z") for name in "abc"))
    stage.add(TELEMETRY, report("a", rtt=rtt(b=None, c=None)), report("b", rtt=rtt(c=1)))
    found = {row["node"]: row["rttP95"] for row in stage.data("nodes")["nodes"]}
    assert found == {"a": "unreachable", "b": "1ms", "c": "1ms"}


def test_an_agent_that_missed_three_heartbeats_is_silent_and_its_readings_count_no_more(stage: Stage) -> None:
    stage.add("/nodes", node("a", zone="z"), node("b", zone="z"))
    stage.add(TELEMETRY, report("a", written_s=400, rtt=rtt(b=1), load={"cpuPercent": 5}))
    (first, _) = stage.data("nodes")["nodes"]
    assert (first["silent"], first["load"], first["rttP95"]) == (True, {}, "")
    assert rows(stage, "nodes")[1][-2:] == ["silent", "6m"]


def test_an_agent_that_never_wrote_has_no_age(stage: Stage) -> None:
    stage.add("/nodes", node("a"))
    stage.add(TELEMETRY, {"metadata": {"name": "a", "managedFields": [{"manager": "o", "time": ago(1)}]}})
    (row,) = stage.data("nodes")["nodes"]
    assert (row["reportedAt"], row["silent"]) == ("", False)


def test_a_node_that_is_not_ready_says_since_when(stage: Stage) -> None:
    stage.add("/nodes", node("a"), node("b", ready=False, since_s=300))
    assert rows(stage, "nodes") == [["NODE", "TIER", "OFFLINE"], ["a"], ["b", "5m"]]
    found = {row["node"]: (row["ready"], bool(row["offlineSince"])) for row in stage.data("nodes")["nodes"]}
    assert found == {"a": (True, False), "b": (False, True)}


def test_a_cordoned_node_does_not_look_like_any_other(stage: Stage) -> None:
    stage.add("/nodes", node("a"), node("b") | {"spec": {"unschedulable": True}})
    assert rows(stage, "nodes") == [["NODE", "TIER", "CORDONED"], ["a"], ["b", "yes"]]
    assert [row["cordoned"] for row in stage.data("nodes")["nodes"]] == [False, True]


def test_devices_of_labels_count_and_the_gpu_of_a_device_plugin_does_not(stage: Stage) -> None:
    shown = node("a", can="true")
    shown["metadata"]["labels"]["hardware.robotics.io/gpu"] = "nvidia"
    stage.add("/nodes", shown)
    assert stage.data("nodes")["nodes"][0]["devices"] == {"free": 1, "held": 0}
    stage.add("robotics.io/robotclaims", held("a", "can-can0"))
    assert stage.data("nodes")["nodes"][0]["devices"] == {"free": 0, "held": 1}


def test_robots_are_shown_by_their_primary_node_with_the_devices_of_all(stage: Stage) -> None:
    stage.add("/nodes", node("edge-1", tier="edge"))
    stage.add("/nodes", node("amr-07-arm", robot="amr-07", can="true"))
    stage.add("/nodes", node("amr-07-pc", robot="amr-07", primary="true", can="true", zone="floor"))
    stage.add("/nodes", node("amr-08", robot="amr-08", ready=False, since_s=200_000))
    assert rows(stage, "robots") == [
        ["ROBOT", "NODE", "ZONE", "FREE/HELD", "OFFLINE"],
        ["amr-07", "amr-07-pc", "+1", "floor", "2/0"],
        ["amr-08", "amr-08", "2d"],
    ]
    assert [robot["nodes"] for robot in stage.data("robots")["robots"]] == [["amr-07-arm", "amr-07-pc"], ["amr-08"]]


def test_a_robot_whose_primary_node_is_unclear_says_what_to_label(stage: Stage) -> None:
    stage.add("/nodes", node("one", robot="amr"), node("two", robot="amr"))
    text = stage.text("robots")
    assert "none is labelled robotics.io/robot-primary=true" in text


@pytest.mark.parametrize("text", ["100Mbps", "-1M", "fast", ""])
def test_a_link_bandwidth_that_cannot_be_read_is_told_below_the_table(stage: Stage, text: str) -> None:
    odd, even = node("edge-1"), node("edge-2")
    odd["metadata"]["annotations"] = {"robotics.io/link-bandwidth": text}
    even["metadata"]["annotations"] = {"robotics.io/link-bandwidth": "40M"}
    stage.add("/nodes", odd, even)
    told = [line for line in stage.text("nodes").splitlines() if line.startswith("node ")]
    assert len(told) == 1
    assert told[0].startswith(
        f"node edge-1: the link counts as unlimited, because its annotation robotics.io/link-bandwidth {text!r} is "
    )


def test_an_empty_cluster_and_one_without_robots_say_so(stage: Stage) -> None:
    assert stage.data("nodes") == {"nodes": []}
    assert "no nodes" in stage.text("nodes")
    stage.add("/nodes", node("a"))
    assert "kubectl label node NODE robotics.io/robot=NAME" in stage.text("robots")


@pytest.mark.parametrize("command", ["nodes", "robots"])
def test_a_thousand_nodes_with_long_names_stay_within_eighty_columns_in_order(stage: Stage, command: str) -> None:
    names = [f"amr-{i:04}.floor.plant-7.example" for i in range(1000)]
    zones = ("europe-west4-a", "europe-west4-b")
    for at, name in enumerate(reversed(names)):
        stage.add("/nodes", node(name, robot=name, tier="robot", zone=zones[at % 2], ready=at != 3, can="true"))
        seen = report(name, written_s=4000 if at == 5 else 4, load={"cpuPercent": 100, "memoryPercent": 100})
        stage.add(TELEMETRY, {**seen, "status": {**seen["status"], "rtt": rtt(**{names[0].replace("-", "_"): 123.4})}})
    result = stage.run(command, COLUMNS="80")
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert max(map(cell_len, lines)) <= 80
    assert [row["node"] for row in stage.data("nodes")["nodes"]] == names
