"""Every attack of the table, over every road a write can take, as the identity it names: refused for the reason it names."""

import json
import re
import secrets
from collections.abc import Iterator
from typing import Any

import pytest
from tests.live.attacks.attackers import Attackers, attacked
from tests.live.attacks.table import ATTACKS, Attack, Road, Stop
from tests.live.attacks.table.escalations import REFERENCES
from tests.live.attacks.table.kinds import POLICY, ROBOTAPP

from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.failures import ApiStatusError

pytestmark = pytest.mark.live
Component = dict[str, Any]


@pytest.fixture(scope="module")
def attackers(installed_plane: ControlPlane) -> Iterator[Attackers]:
    end = secrets.token_hex(3)
    with attacked(installed_plane, f"attacker-{end}", f"victim-{end}") as found:
        yield found


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.key)
def test_an_attack_is_refused_over_every_road(attackers: Attackers, attack: Attack) -> None:
    wrong = []
    for road in Road:
        try:
            attackers.attempt(attack, road)
        except ApiStatusError as error:
            if not re.search(attack.message, error.message):
                wrong.append(f"{road}: refused for another reason: {error.status} {error.message}")
        else:
            wrong.append(f"{road}: accepted")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    "attack", [each for each in ATTACKS if each.stop is Stop.SCHEMA], ids=lambda attack: attack.key
)
def test_a_field_that_does_not_exist_is_dropped_where_nobody_wants_it_refused(
    attackers: Attackers, attack: Attack
) -> None:
    wrong = []
    for road in Road:
        try:
            stored = attackers.attempt(attack, road, validation="Ignore", suffix="-dropped")
        except ApiStatusError as error:
            if not re.search(f"{attack.message}|is invalid", error.message):
                wrong.append(f"{road}: refused for another reason: {error.status} {error.message}")
        else:
            if attack.holds(stored):
                wrong.append(f"{road}: stored {stored['spec']}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("attack", REFERENCES, ids=lambda attack: attack.key)
def test_who_may_create_pods_may_name_accounts_and_secrets(attackers: Attackers, attack: Attack) -> None:
    for road in Road:
        assert attack.holds(attackers.attempt(attack, road, who="tenant", suffix="-tenant"))


def test_suspend_and_metadata_stay_free_for_who_may_write_the_app(attackers: Attackers) -> None:
    namespace = attackers.namespaces["own"]
    account = next(attack for attack in REFERENCES if attack.key == "account")
    name = attackers.attempt(account, Road.CREATE, who="tenant", suffix="-suspended")["metadata"]["name"]
    path, clerk = ROBOTAPP.path(namespace, name), attackers.apis["clerk"]
    for suspend in (True, False):
        assert clerk.patch(path, {"spec": {"suspend": suspend}})["spec"]["suspend"] is suspend
    assert clerk.patch(path, {"metadata": {"labels": {"team": "a"}}})["metadata"]["labels"] == {"team": "a"}
    cleared = {"spec": {"components": [{"name": "driver", "image": "ros:humble"}]}}
    assert "template" not in clerk.patch(path, cleared)["spec"]["components"][0], (
        "taking the reference out is no escalation"
    )


_ENDS = {"ros": {"distro": "humble"}, "components": [{"name": "save", "image": "x", "job": {}}]}
_HAS_ENDED = {"phase": "Completed", "completionTime": "2026-01-01T00:00:00Z", "observedGeneration": 1}


@pytest.mark.parametrize(
    ("name", "completion", "status"),
    [
        ("no-ttl", {}, _HAS_ENDED),
        ("runs", {"ttl": "1h"}, {"phase": "Running", "observedGeneration": 1}),
        ("refused", {"ttl": "1h"}, {"phase": "Failed", "observedGeneration": 1}),
        ("edited", {"ttl": "1h"}, _HAS_ENDED | {"observedGeneration": 0}),
    ],
)
def test_the_operators_token_deletes_no_app_that_does_not_ask_for_it_or_has_not_ended(
    attackers: Attackers, name: str, completion: dict[str, Any], status: dict[str, Any]
) -> None:
    """The status decides, which the operator writes: whoever holds its token can end an app with ttl early, and no
    other app.
    """
    path = _store_app(attackers, name, completion, status)
    with pytest.raises(ApiStatusError, match=r"so the robotapp operator may not delete it; delete it yourself"):
        attackers.apis["operator"].delete(path)
    with pytest.raises(ApiStatusError, match=r"cannot delete(collection)? resource"):
        attackers.apis["operator"].delete(path.rpartition("/")[0])
    attackers.apis["clerk"].delete(path)


def test_the_operators_token_deletes_an_app_that_has_ended_and_asks_for_it(attackers: Attackers) -> None:
    path = _store_app(attackers, "has-ended", {"ttl": "1h"}, _HAS_ENDED)
    attackers.apis["operator"].delete(path)
    with pytest.raises(ApiStatusError, match="not found"):
        attackers.admin.get(path)


def _store_app(attackers: Attackers, name: str, completion: dict[str, Any], status: dict[str, Any]) -> str:
    """Stores an app with this status; returns its path."""
    collection = ROBOTAPP.path(attackers.namespaces["own"])
    body = {"apiVersion": ROBOTAPP.version, "kind": ROBOTAPP.kind, "metadata": {"name": name}}
    attackers.admin.create(collection, body | {"spec": _ENDS | {"completion": completion}})
    attackers.admin.patch(f"{collection}/{name}/status", {"status": status})
    return f"{collection}/{name}"


_ENV = [{"name": f"A{index}"} for index in range(128)]
_FROM_POD = [{"name": f"A{index}", "valueFrom": {"fieldRef": {"fieldPath": "x"}}} for index in range(128)]
_SOURCE = {"downwardAPI": {}}
_LARGEST: dict[str, Component] = {
    "environment": {
        "env": _ENV,
        "template": {
            "spec": {"initContainers": [{"name": f"i{n}", "image": "x", "env": _ENV} for n in range(7)]},
        },
    },
    "values of the pod": {
        "env": _FROM_POD,
        "template": {"spec": {"initContainers": [{"name": "i", "image": "x", "env": _FROM_POD}]}},
    },
    "projected sources": {
        "template": {
            "spec": {"volumes": [{"name": f"v{n}", "projected": {"sources": [_SOURCE] * 60}} for n in range(12)]}
        }
    },
}


@pytest.mark.parametrize("component", _LARGEST.values(), ids=_LARGEST)
def test_an_app_as_large_as_the_api_server_takes_it_is_within_the_policys_cost(
    attackers: Attackers, component: Component
) -> None:
    """A policy that runs out of its budget refuses: who names no Secret must not be refused for the length of his app."""
    app = {
        "apiVersion": ROBOTAPP.version,
        "kind": ROBOTAPP.kind,
        "metadata": {"name": "large"},
        "spec": {
            "ros": {"distro": "humble"},
            "components": [{"name": f"c{n}", "image": "x", **component} for n in range(64)],
        },
    }
    assert len(json.dumps(app)) > 1_000_000
    stored = attackers.apis["clerk"].create(f"{ROBOTAPP.path(attackers.namespaces['own'])}?dryRun=All", app)
    assert len(stored["spec"]["components"]) == 64


def test_the_api_servers_type_checker_has_nothing_to_say_about_our_policies(attackers: Attackers) -> None:
    def checked() -> list[dict[str, Any]]:
        items = attackers.admin.get(POLICY.path(""))["items"]
        return [
            item for item in items if item.get("status", {}).get("observedGeneration") == item["metadata"]["generation"]
        ]

    names = {
        "robotapp-references",
        "robotapp-membership",
        "robotapp-instances",
        "robotapp-expiry",
        "robotapp-grants-pods",
    }
    assert wait_until(lambda: names <= {item["metadata"]["name"] for item in checked()}, timeout_s=60)
    warnings = {item["metadata"]["name"]: item["status"].get("typeChecking", {}) for item in checked()}
    assert not {name: found for name, found in warnings.items() if found.get("expressionWarnings")}
