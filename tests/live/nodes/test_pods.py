"""What pods find on real nodes: the API server, names, Services, each other, and the delay that was set."""

import sys
from typing import Any

import pytest

from campaigns.nodes import real_pods
from campaigns.nodes.real_pods import pod, shell
from robotapp_testbed import TestbedError, wait_until
from robotapp_testbed.real import RealNodes
from robotapp_testbed.real.config.addresses import API_SERVICE_IP, DNS_SERVICE_IP

pytestmark = pytest.mark.live


def server(name: str, node: str) -> dict[str, Any]:
    """A web server that says its pod's name."""
    line = "cd $(mktemp -d) && hostname > index.html && exec httpd -f -p 8080"
    return pod(name, node, ["sh", "-c", line])


def test_a_node_says_what_its_factory_says(real_nodes: RealNodes) -> None:
    node = real_nodes.api.get("/api/v1/nodes/robot-1")
    assert node["metadata"]["labels"]["robotics.io/tier"] == "robot"
    assert node["metadata"]["labels"]["kubernetes.io/arch"] in {"amd64", "arm64"}
    assert "robotics.io/simulated" not in node["metadata"]["labels"]
    assert {"type": "InternalIP", "address": real_nodes.node("robot-1").ip} in node["status"]["addresses"]


def test_a_scheduled_pod_runs_says_something_and_is_entered(real_nodes: RealNodes, real_namespace: str) -> None:
    talker = pod("talker", "", ["sh", "-c", "echo hello from $HOSTNAME; sleep 1000"])
    del talker["spec"]["nodeName"]
    real_pods.run(real_nodes, real_namespace, talker)
    assert real_nodes.kubectl("logs", "-n", real_namespace, "talker") == "hello from talker\n"
    assert shell(real_nodes, real_namespace, "talker", "hostname") == "talker\n"
    stats = real_nodes.api.get("/api/v1/nodes/robot-1/proxy/stats/summary")
    assert stats["node"]["nodeName"] == "robot-1"


def test_services_and_headless_services_resolve_and_answer(real_nodes: RealNodes, real_namespace: str) -> None:
    objects = [server("near", "robot-1"), server("far", "edge-1"), pod("client", "robot-1")]
    services = [real_pods.service("near"), real_pods.service("far"), real_pods.service("all", headless=True)]
    services[2]["spec"]["selector"] = {"group": "all"}
    for each in objects[:2]:
        each["metadata"]["labels"]["group"] = "all"
    real_nodes.kubectl("apply", "-n", real_namespace, "-f", "-", stdin=services)
    real_pods.run(real_nodes, real_namespace, *objects)

    def said(line: str) -> str:
        return shell(real_nodes, real_namespace, "client", f"for try in $(seq 60); do {line} && break; sleep 0.5; done")

    for name in ("near", "far"):
        for host in (name, f"{name}.{real_namespace}.svc.cluster.local"):
            assert said(f"printf 'GET / HTTP/1.0\\r\\n\\r\\n' | nc -w 2 {host} 8080 | grep -x {name}") == f"{name}\n"
    addresses = {real_pods.address(real_nodes, real_namespace, name) for name in ("near", "far")}

    def all_found() -> bool:
        return addresses <= set(said(f"nslookup all.{real_namespace}.svc.cluster.local").split())

    # A name with one of two addresses is a true answer, too, until the endpoints and the name server's memory follow.
    assert wait_until(all_found, timeout_s=60)
    assert DNS_SERVICE_IP in shell(real_nodes, real_namespace, "client", "cat /etc/resolv.conf")


def test_a_pod_reaches_the_api_server_with_its_token(real_nodes: RealNodes, real_namespace: str) -> None:
    real_pods.run(real_nodes, real_namespace, pod("asker", "edge-1"))
    folder = "/var/run/secrets/kubernetes.io/serviceaccount"
    token = shell(real_nodes, real_namespace, "asker", f"cat {folder}/token")
    authority = shell(real_nodes, real_namespace, "asker", f"cat {folder}/ca.crt")
    program = (
        "import ssl, sys, urllib.request\n"
        "token, _, authority = sys.stdin.read().partition('\\n')\n"
        f"url = 'https://{API_SERVICE_IP}/apis/authentication.k8s.io/v1/selfsubjectreviews'\n"
        'body = b\'{"kind":"SelfSubjectReview","apiVersion":"authentication.k8s.io/v1"}\'\n'
        "headers = {'Authorization': f'Bearer {token}', 'Content-Type': 'application/json'}\n"
        "context = ssl.create_default_context(cadata=authority)\n"
        "print(urllib.request.urlopen(urllib.request.Request(url, body, headers), context=context).read().decode())\n"
    )
    node = real_nodes.node("edge-1")
    container_id = real_pods.container(real_nodes, real_namespace, "asker")["containerID"].rpartition("/")[2]
    pid = next(line.split()[1] for line in node.ctr("tasks", "list").splitlines() if line.startswith(container_id))
    # The host's Python in the pod's network: the tools image has no TLS.
    argv = ["/usr/bin/nsenter", "-t", pid, "-n", sys.executable, "-c", program]
    assert f"system:serviceaccount:{real_namespace}:default" in node.box.run(*argv, stdin=f"{token}\n{authority}")


def test_the_delay_between_two_nodes_is_what_was_set(real_nodes: RealNodes, real_namespace: str) -> None:
    real_pods.run(real_nodes, real_namespace, pod("here", "robot-1"), pod("there", "edge-1"))
    target = real_pods.address(real_nodes, real_namespace, "there")
    plain_ms = real_pods.round_trip_ms(real_nodes, real_namespace, "here", target)
    real_nodes.switch.set_link("robot-1", "edge-1", delay_ms=20)
    try:  # other programs of this machine can only add to it, so the quickest of a few counts
        trips = [real_pods.round_trip_ms(real_nodes, real_namespace, "here", target) for _ in range(4)]
        assert 40 <= min(trips) <= 45 + plain_ms
    finally:
        real_nodes.switch.set_link("robot-1", "edge-1", delay_ms=0)


def test_a_secret_reaches_only_the_node_that_runs_its_pod(real_nodes: RealNodes) -> None:
    listing = real_nodes.kubectl("get", "secrets", "-A", identity="node-edge-1", check=False)
    assert "can only list/watch" in listing or "forbidden" in listing.lower()


def test_unknown_nodes_are_answered_with_the_known_ones(real_nodes: RealNodes) -> None:
    with pytest.raises(TestbedError, match=r"no node cloud-9; the cluster has robot-1, edge-1"):
        real_nodes.node("cloud-9")
