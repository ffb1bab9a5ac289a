"""Access to the node on a real API server: refused without the right, admitted with it, and guarded is exactly what `baseline` forbids.

That a writer of RobotApps is refused over every road is in `test_refused_attacks_live.py`, which runs the same table.
"""

import json
import random
import re
import secrets
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from tests.live.attacks.attackers import Attackers, attacked
from tests.live.attacks.table.attack import Attack, Road
from tests.live.attacks.table.host_access import (
    BAD,
    HOST,
    app_with_everything_free,
    honest_app,
    key_of,
    places_of,
    written,
)
from tests.live.attacks.table.kinds import ROBOTAPP, app, templated

from robotapp_api.checks.host_access.guarded import find_rights
from robotapp_api.checks.host_access.table import GUARDED, HostRight
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_operator.plan.render.parameters import NONE
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.spec.desired import App, desired_of
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.api import Api
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.failures import ApiStatusError, CommandError

pytestmark = pytest.mark.live
Json = dict[str, Any]
BASELINE = "pod-security.kubernetes.io/enforce=baseline"
MIXTURES = 60


@pytest.fixture(scope="module")
def attackers(installed_plane: ControlPlane) -> Iterator[Attackers]:
    end = secrets.token_hex(3)
    with attacked(installed_plane, f"host-{end}", f"host-victim-{end}") as found:
        yield found


@pytest.fixture(scope="module")
def holders(installed_plane: ControlPlane, attackers: Attackers) -> Iterator[Mapping[HostRight, Api]]:
    """By right: an account with robotapp-editor and that right alone."""
    plane, own = installed_plane, attackers.namespaces["own"]
    apis = {}
    for right in HostRight:
        plane.kubectl("create", "serviceaccount", right.value, "-n", own)
        for role in ("robotapp-editor", f"robotapp-use-{right.value}"):
            account = f"--serviceaccount={own}:{right.value}"
            plane.kubectl("create", "rolebinding", f"{right.value}-{role}", f"--clusterrole={role}", account, "-n", own)
        token = plane.kubectl("create", "token", right.value, "-n", own).strip()
        apis[right] = Api(plane.server_url, ca_file=plane.ca_file, token=token)
    yield apis
    for api in apis.values():
        api.close()


@pytest.fixture(scope="module")
def baseline(installed_plane: ControlPlane) -> Iterator[str]:
    """A namespace with the level `baseline`, of the server's own version."""
    with created(installed_plane, f"baseline-{secrets.token_hex(3)}") as name:
        installed_plane.kubectl("label", "namespace", name, BASELINE)
        yield name


def attack_of(key: str) -> Attack:
    return next(attack for attack in HOST if attack.key == key)


@pytest.mark.parametrize("field", GUARDED, ids=lambda field: f"{field.level.value}: {field.path}")
def test_with_the_right_a_guarded_field_is_admitted_over_every_road_in_every_place(
    attackers: Attackers, holders: Mapping[HostRight, Api], field: Any
) -> None:
    whole = Attackers(attackers.admin, {"holder": holders[field.right]}, attackers.namespaces)
    for kind in places_of(field):
        attack = attack_of(key_of(field, kind))
        for road in Road:
            stored = whole.attempt(attack, road, who="holder", suffix="-held")
            assert attack.holds(stored)


@pytest.mark.parametrize("right", HostRight)
def test_a_right_is_good_for_its_own_fields_alone(
    attackers: Attackers, holders: Mapping[HostRight, Api], right: HostRight
) -> None:
    for attack in HOST:
        needed = re.search(r"robotapps/(\w+)", attack.says)
        if needed and needed[1] == right.value and attack.key.endswith("-own"):
            for other in set(HostRight) - {right}:
                whole = Attackers(attackers.admin, {"holder": holders[other]}, attackers.namespaces)
                with pytest.raises(ApiStatusError, match=attack.message):
                    whole.attempt(attack, Road.CREATE, who="holder", suffix=f"-{other.value}")


def test_the_refusal_names_the_field_and_the_command_that_gives_the_right(attackers: Attackers) -> None:
    own = attackers.namespaces["own"]
    body = templated(volumes=[{"name": "dev", "hostPath": {"path": "/dev"}}])
    with pytest.raises(ApiStatusError) as refused:
        attackers.apis["editor"].create(ROBOTAPP.path(own), robotapp("told", body))
    assert (
        f"component driver mounts files of its node (volumes.hostPath); who writes such an app needs the verb use on robotapps/hostpath "
        f"in namespace {own}: leave it out, or ask whoever runs the cluster for kubectl create rolebinding robotapp-use-hostpath "
        f"--clusterrole=robotapp-use-hostpath --user=system:serviceaccount:{own}:editor -n {own}"
    ) in refused.value.message


def test_suspend_metadata_and_taking_the_field_out_are_free_and_nothing_else(attackers: Attackers) -> None:
    own, editor = attackers.namespaces["own"], attackers.apis["editor"]
    path = ROBOTAPP.path(own, "before")
    attackers.admin.create(ROBOTAPP.path(own), robotapp("before", app(securityContext={"privileged": True})))
    for suspend in (True, False):
        assert editor.patch(path, {"spec": {"suspend": suspend}})["spec"]["suspend"] is suspend
    assert editor.patch(path, {"metadata": {"labels": {"team": "a"}}})["metadata"]["labels"] == {"team": "a"}
    for change in ({"connectivity": {"grace": "1m"}}, {"suspend": True, "update": {"operator": "OnDemand"}}):
        with pytest.raises(ApiStatusError, match="without it only suspend may be changed"):
            editor.patch(path, {"spec": change})
    plain = [{"name": "driver", "image": "ros:humble"}]
    assert "securityContext" not in editor.patch(path, {"spec": {"components": plain}})["spec"]["components"][0]


def test_every_right_on_robotapps_themselves_is_not_enough(installed_plane: ControlPlane, attackers: Attackers) -> None:
    own = attackers.namespaces["own"]
    with pytest.raises(ApiStatusError, match="needs the verb use on robotapps/hostnetwork"):
        attackers.apis["clerk"].create(ROBOTAPP.path(own), robotapp("clerks", templated(hostNetwork=True)))
    answers = [
        installed_plane.kubectl(
            "auth",
            "can-i",
            "use",
            "robotapps.robotics.io",
            f"--subresource={right.value}",
            "-n",
            own,
            f"--as={who}",
            check=False,
        )
        for right in HostRight
        for who in ("tenant", f"system:serviceaccount:{own}:editor")
    ]
    assert {answer.split()[0] for answer in answers} == {"no"}


def test_values_that_are_free_take_no_right_and_pass_baseline(
    installed_plane: ControlPlane, attackers: Attackers, baseline: str
) -> None:
    free = app_with_everything_free()
    attackers.apis["editor"].create(ROBOTAPP.path(attackers.namespaces["own"]), robotapp("free", free))
    assert refusal_of_pod(installed_plane, baseline, free) == ""


@pytest.mark.parametrize("seed", range(MIXTURES))
def test_table_policy_and_pod_security_agree_about_any_mixture(
    installed_plane: ControlPlane, attackers: Attackers, baseline: str, seed: int
) -> None:
    """Guarded and free values of some fields in some containers of one component: three judges, one answer."""
    mixture = mix(random.Random(seed))
    spec = RobotAppSpec.model_validate(mixture["spec"])
    refused_by_policy = ""
    try:
        path = f"{ROBOTAPP.path(attackers.namespaces['own'])}?dryRun=All"
        attackers.apis["editor"].create(path, robotapp(f"mixed-{seed}", mixture))
    except ApiStatusError as error:
        refused_by_policy = error.message
    rights = find_rights(spec)
    assert bool(refused_by_policy) is bool(rights), refused_by_policy
    assert all("needs the verb use on" in text for text in [refused_by_policy] if text)
    refused_pod = refusal_of_pod(installed_plane, baseline, mixture)
    assert bool(refused_pod) is bool(rights), refused_pod


def test_the_policy_of_the_largest_app_stays_within_its_cost(attackers: Attackers) -> None:
    """A policy that runs out of its budget refuses: who asks for nothing must not be refused for the length of the app."""
    ports = [{"containerPort": 1 + n, "protocol": "TCP"} for n in range(64)]
    added = {"capabilities": {"add": ["KILL"] * 64}}
    further = [{"name": f"n{n}", "image": "x"} for n in range(8)]
    shapes: dict[str, Json] = {
        "containers": {"template": {"spec": {"containers": further, "initContainers": further[:7]}}},
        "ports": {"ports": ports, "template": {"spec": {"containers": [{**each, "ports": ports} for each in further]}}},
        "capabilities": {
            "securityContext": added,
            "template": {"spec": {"containers": [{**each, "securityContext": added} for each in further]}},
        },
        "sysctls": {
            "template": {
                "spec": {
                    "securityContext": {"sysctls": [{"name": "kernel.shm_rmid_forced", "value": "1"}] * 64},
                    "volumes": [{"name": f"v{n}", "emptyDir": {}} for n in range(64)],
                }
            }
        },
        "annotations": {"template": {"metadata": {"annotations": {f"a.b/{n}": "x" for n in range(32)}}}},
    }
    for name, shape in shapes.items():
        components = [{"name": f"c{n}", "image": "x", **shape} for n in range(64)]
        large = {"spec": {"ros": {"distro": "humble"}, "components": components}}
        path = f"{ROBOTAPP.path(attackers.namespaces['own'])}?dryRun=All"
        stored = attackers.apis["editor"].create(path, robotapp(f"large-{name}", large))
        assert len(stored["spec"]["components"]) == 64


def robotapp(name: str, body: Json) -> Json:
    return {"apiVersion": ROBOTAPP.version, "kind": ROBOTAPP.kind, "metadata": {"name": name}, **body}


def mix(rng: random.Random) -> Json:
    """The honest app with a few fields of its first component set, to bad values about as often as to free ones."""
    whole, sets = honest_app(), set()
    for field in rng.sample(GUARDED, 6):
        if exclusive_set(field.path) in sets:
            continue
        sets.add(exclusive_set(field.path))
        kinds = [kind for kind, place in places_of(field).items() if "components[0]" in place]
        if is_of_handlers(field.path):
            kinds.remove("init container")  # it runs to its end, so it has no probes
        free = ("runtime/default",) if field.level.value == "annotations" else field.free
        free = tuple(each for each in free if each != "Localhost")  # which needs a profile beside it
        value = rng.choice(free) if free and rng.random() < 0.75 else BAD[field.path]
        if field.path.endswith("procMount") or "windowsOptions" in field.path:
            continue  # the API server refuses these pods for other reasons
        part = written(field, places_of(field)[rng.choice(kinds)], value)["spec"]["components"][0]
        whole["spec"]["components"][0] = join(whole["spec"]["components"][0], part)
    return whole


def is_of_handlers(path: str) -> bool:
    return path.endswith(("Get.host", "Socket.host"))


def exclusive_set(path: str) -> str:
    """Fields of one set exclude each other in a pod, for reasons that have nothing to do with Pod Security."""
    if is_of_handlers(path):
        return path.rsplit(".", 2)[0]
    if "apparmor" in path.lower():
        return "AppArmor"
    return "namespaces" if "sysctls" in path or path in ("hostNetwork", "hostIPC", "hostPID") else path


def join(first: Any, second: Any) -> Any:
    if isinstance(first, dict) and isinstance(second, dict):
        return {**first, **{key: join(first[key], value) if key in first else value for key, value in second.items()}}
    if isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        return [join(*pair) for pair in zip(first, second, strict=True)]
    return second


def refusal_of_pod(plane: ControlPlane, namespace: str, body: Json) -> str:
    """What Pod Security says of the first component's pod, as the operator renders it; "" where it admits the pod."""
    spec = RobotAppSpec.model_validate(body["spec"])
    whole = App(name="mixed", namespace=namespace, uid="u", generation=1, spec=spec)
    template = pod_template(spec.components[0], desired_of(whole, ""), domain=None, state=NONE)
    metadata = {"name": "mixed", "namespace": namespace, "annotations": template["metadata"].get("annotations", {})}
    pod = {"apiVersion": "v1", "kind": "Pod", "metadata": metadata, "spec": template["spec"]}
    try:
        plane.kubectl("create", "--dry-run=server", "-f", "-", stdin=json.dumps(pod))
    except CommandError as error:
        refusal = error.stderr
    else:
        return ""
    assert "violates PodSecurity" in refusal, refusal
    return refusal
