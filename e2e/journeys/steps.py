"""The demo's story, one function per step. Every step checks what it says; the wording is for somebody who knows ROS."""

import time
from typing import Any

import yaml

from journeys.demo_cluster import NAMESPACE, DemoCluster, condition, is_ready
from journeys.stage import Stage, wait_for
from robotapp_testbed import ApiStatusError

READY_GOAL_S, READY_LIMIT_S = 2.0, 10.0
"""What an idle machine keeps easily, and what even a busy one must: a demo does not end because a laptop compiles."""


def apply_teleop(stage: Stage, demo: DemoCluster) -> None:
    stage.step("One object for a robot application")
    began_s = time.monotonic()
    stage.shell("kubectl apply -f examples/teleop.yaml", demo.apply_file("examples/teleop.yaml"))
    app, _ = wait_for("teleop Ready", lambda: _if_ready(demo, "teleop"), within_s=60)
    took_s = time.monotonic() - began_s
    stage.shell("kubectl get ra", demo.kubectl("get", "ra"))
    aim = f"aim {'met' if took_s <= READY_GOAL_S else 'missed: this machine is busy or slow'}: {READY_GOAL_S:g} s"
    stage.claim(f"Ready {took_s:.2f} s after kubectl was started ({aim})", took_s <= READY_LIMIT_S)
    summary = app["status"]["summary"]
    domain = summary["domain"]
    named = {
        _domain_of(deployment)
        for deployment in demo.items("deployments", "-l", "robotics.io/app=teleop,robotics.io/component")
    }
    stage.claim(
        f"all its processes share DDS domain {domain} and no other", named == {domain}, f"templates name {named}"
    )
    stage.claim(f"its latency budget is met: {summary['budget']}", condition(app, "BudgetMet").get("status") == "True")
    (instance,), _ = wait_for("teleop's instance", lambda: _ready_instances(demo, "teleop"), within_s=10)
    stage.shell("kubectl get rai", demo.kubectl("get", "rai"))
    robot, own = instance["spec"]["robot"], str(instance["status"].get("domain"))
    stage.claim(f"robot {robot} has an object of its own to watch, in the same domain", own == domain, own)


def explain_teleop(stage: Stage, demo: DemoCluster) -> None:
    stage.step("Why there? The scheduler explains every node it refused")
    text = demo.robotapp("explain", "teleop", "--scheduler-url", demo.scheduler.health_url)
    stage.shell("kubectl robotapp explain teleop", text)
    stage.claim("the cloud node was refused for its measured latency", "cloud-1: " in text and "ms" in text, text)


def share_a_can_bus(stage: Stage, demo: DemoCluster) -> None:
    stage.step("Two applications, one CAN bus")
    stage.shell("kubectl apply -f examples/can-holder.yaml", demo.apply_file("examples/can-holder.yaml"))
    wait_for("can-holder Ready", lambda: _if_ready(demo, "can-holder"), within_s=60)
    stage.shell("kubectl apply -f examples/can-rival.yaml", demo.apply_file("examples/can-rival.yaml"))
    app, _ = wait_for("the refusal", lambda: _if_busy(demo, "can-rival"), within_s=60)
    refusal = condition(app, "Allocated")
    stage.say(f"Allocated=False  {refusal['reason']}: {refusal['message']}")
    stage.claim("the refusal names who holds the bus", "can-holder" in refusal["message"], refusal["message"])
    stage.shell("kubectl robotapp devices", demo.robotapp("devices"))
    stage.shell("kubectl delete ra can-holder", demo.kubectl("delete", "ra", "can-holder"))
    _, took_s = wait_for("can-rival Ready", lambda: _if_ready(demo, "can-rival"), within_s=60)
    stage.claim(f"the rival runs {took_s * 1000:.0f} ms after the holder was deleted", took_s < 10)
    demo.kubectl("delete", "ra", "can-rival")


def render_from_rigel(stage: Stage, demo: DemoCluster) -> None:
    stage.step("From a Rigelfile to a running application")
    rendered = demo.run("rigel-bridge", "render", "examples/rigel/teleop/Rigelfile")
    applied = demo.apply(*yaml.safe_load_all(rendered))
    stage.shell("rigel-bridge render examples/rigel/teleop/Rigelfile | kubectl apply -f -", applied)
    name = applied.split("/")[1].split()[0]
    _, took_s = wait_for(f"{name} Ready", lambda: _if_ready(demo, name), within_s=60)
    stage.claim(f"{name} is Ready after {took_s:.2f} s", took_s < 10)
    demo.kubectl("delete", "ra", name)


def open_console(stage: Stage, demo: DemoCluster) -> None:
    stage.step("The same in a browser")
    session = demo.console.open_session()
    stage.shell("kubectl robotapp console")
    status, page = demo.console.read_page("/", session)
    stage.claim("the fleet is shown, with the robot and its app", status == 200 and _shows_teleop(page), page)
    status, page = demo.console.read_page(f"/apps/{NAMESPACE}/teleop", session)
    stage.claim("the app is shown with its edges and their budgets", status == 200 and "/cmd_vel" in page, page)


def _shows_teleop(page: str) -> bool:
    return 'id="robot-amr-07"' in page and f'href="/apps/{NAMESPACE}/teleop' in page


def _if_ready(demo: DemoCluster, name: str) -> dict[str, Any] | None:
    app = _read(demo, name)
    return app if app and is_ready(app) else None


def _ready_instances(demo: DemoCluster, name: str) -> list[dict[str, Any]]:
    """The app's RobotAppInstances as soon as one is Ready: they are written after the app's own status."""
    found = demo.items("robotappinstances", "-l", f"robotics.io/app={name}")
    return found if any(condition(each, "Ready").get("status") == "True" for each in found) else []


def _if_busy(demo: DemoCluster, name: str) -> dict[str, Any] | None:
    app = _read(demo, name)
    return app if app and condition(app, "Allocated").get("reason") == "DeviceBusy" else None


def _read(demo: DemoCluster, name: str) -> dict[str, Any] | None:
    try:
        return demo.app(name)
    except ApiStatusError as error:
        if error.status == 404:
            return None
        raise


def _domain_of(deployment: dict[str, Any]) -> str:
    variables = deployment["spec"]["template"]["spec"]["containers"][0].get("env", [])
    return next((v.get("value", "") for v in variables if v["name"] == "ROS_DOMAIN_ID"), "none")
