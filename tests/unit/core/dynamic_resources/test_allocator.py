"""Which devices a claim gets on one node."""

import pytest
from tests.support.scheduler.allocations import (
    allocate,
    make_class,
    make_device,
    make_inventory,
    make_request,
    make_requirements,
    make_resource_claim,
    make_slice,
    names_of,
)

from robotapp_scheduler.core.dynamic_resources.allocator import SearchTooLongError
from robotapp_scheduler.core.dynamic_resources.errors import AllocationError, NodeAllocationError
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim

LIDAR = 'device.attributes["devices.example.com"].type == "lidar"'
SENSORS = make_slice(
    make_device("cam-0", attributes={"type": "camera", "bus": 0}),
    make_device("cam-1", attributes={"type": "camera", "bus": 1}),
    make_device("lidar-0", attributes={"type": "lidar", "bus": 1}),
    make_device("lidar-1", attributes={"type": "lidar", "bus": 1}),
)


def test_the_first_device_in_the_order_of_pools_slices_and_devices_is_taken() -> None:
    inventory = make_inventory(
        make_slice("z", pool="b"),
        make_slice("y", name="s2", pool="a", of=2),
        make_slice("x", name="s1", pool="a", of=2),
    )
    request = make_request(count=3)
    assert names_of(allocate(inventory, make_resource_claim(request))) == [["x", "y", "z"]]


def test_a_device_of_another_claim_is_not_taken_again() -> None:
    claim = make_resource_claim(make_request("r", LIDAR))
    inventory = make_inventory(SENSORS)
    assert names_of(allocate(inventory, claim, allocated={"lidar-0"})) == [["lidar-1"]]
    assert allocate(inventory, claim, allocated={"lidar-0", "lidar-1"}) is None


def test_claims_of_one_pod_get_different_devices() -> None:
    claims = [make_resource_claim(make_request("r", LIDAR), name=name) for name in ("first", "second", "third")]
    inventory = make_inventory(SENSORS)
    assert names_of(allocate(inventory, *claims[:2])) == [["lidar-0"], ["lidar-1"]]
    assert allocate(inventory, *claims) is None


def test_an_earlier_request_takes_another_device_when_a_later_one_needs_its_own() -> None:
    picky = make_request("picky", 'device.attributes["devices.example.com"].bus == 0')
    claim = make_resource_claim(make_request("any"), picky)
    assert names_of(allocate(make_inventory(SENSORS), claim)) == [["cam-1", "cam-0"]]


def test_a_claim_without_requests_gets_an_allocation_without_devices() -> None:
    (allocation,) = allocate(make_inventory(SENSORS), make_resource_claim()) or ()
    assert allocation.devices.results == ()
    assert allocation.node_selector is None


def test_all_takes_every_device_that_matches_or_none() -> None:
    claim = make_resource_claim(make_request("r", LIDAR, allocationMode="All"))
    inventory = make_inventory(SENSORS)
    assert names_of(allocate(inventory, claim)) == [["lidar-0", "lidar-1"]]
    assert allocate(inventory, claim, allocated={"lidar-1"}) is None
    assert allocate(inventory, make_resource_claim(make_request("r", "false", allocationMode="All"))) is None


def test_all_waits_for_pools_that_are_being_updated() -> None:
    inventory = make_inventory(SENSORS, make_slice("new", pool="growing", of=2))
    with pytest.raises(AllocationError, match=r"resource pool devices.example.com/growing is currently being updated"):
        allocate(inventory, make_resource_claim(make_request("r", allocationMode="All")))
    assert names_of(allocate(inventory, make_resource_claim(make_request("r")))) == [["cam-0"]]


def test_the_first_alternative_that_fits_is_served() -> None:
    parts = [
        {"name": "three", **make_requirements(LIDAR, count=3)},
        {"name": "two", **make_requirements(LIDAR, count=2)},
        {"name": "one", **make_requirements()},
    ]
    claim = make_resource_claim({"name": "best", "firstAvailable": parts})
    inventory = make_inventory(SENSORS)
    (allocation,) = allocate(inventory, claim) or ()
    assert [(result.request, result.device) for result in allocation.devices.results] == [
        ("best/two", "lidar-0"),
        ("best/two", "lidar-1"),
    ]
    assert names_of(allocate(inventory, claim, allocated={"lidar-0"})) == [["cam-0"]]


def test_an_alternative_that_would_make_the_claim_too_large_is_passed_over() -> None:
    inventory = make_inventory(make_slice(*(f"d{i}" for i in range(40))))
    parts = [{"name": "many", **make_requirements(count=10)}, {"name": "few", **make_requirements(count=2)}]
    claim = make_resource_claim(make_request("first", count=30), {"name": "then", "firstAvailable": parts})
    (allocation,) = allocate(inventory, claim) or ()
    assert len(allocation.devices.results) == 32
    assert allocation.devices.results[-1].request == "then/few"


def test_more_devices_than_an_allocation_can_hold_are_refused() -> None:
    claim = make_resource_claim(make_request("a", count=30), make_request("b", count=3))
    with pytest.raises(
        AllocationError, match=r"request b: adding 3 devices exceeds the claim limit of 32, with 30 already"
    ):
        allocate(make_inventory(SENSORS), claim)


@pytest.mark.parametrize(
    ("constraint", "names"),
    [
        ({"matchAttribute": "devices.example.com/bus"}, ["cam-1", "lidar-0"]),
        ({"matchAttribute": "devices.example.com/type"}, ["cam-0", "cam-1"]),
        ({"distinctAttribute": "devices.example.com/bus"}, ["cam-0", "cam-1"]),
        ({"matchAttribute": "devices.example.com/bus", "requests": ["a"]}, ["cam-0", "cam-1"]),
        ({"matchAttribute": "devices.example.com/absent"}, None),
    ],
)
def test_constraints_hold_between_the_devices_of_a_claim(
    constraint: dict[str, object], names: list[str] | None
) -> None:
    claim = make_resource_claim(make_request("a"), make_request("b"), constraints=[constraint])
    assert names_of(allocate(make_inventory(SENSORS), claim)) == (names and [names])


def test_all_against_a_constraint_is_the_claims_mistake() -> None:
    claim = make_resource_claim(
        make_request("r", allocationMode="All"), constraints=[{"matchAttribute": "devices.example.com/type"}]
    )
    with pytest.raises(AllocationError, match=r"cannot add device devices.example.com/robot-1/lidar-0 because"):
        allocate(make_inventory(SENSORS), claim)


def test_admin_access_takes_devices_in_use_and_leaves_them_to_others() -> None:
    admin = make_resource_claim(make_request("r", LIDAR, adminAccess=True), name="admin")
    (allocation,) = allocate(make_inventory(SENSORS), admin, allocated={"lidar-0"}) or ()
    assert [(result.device, result.admin_access) for result in allocation.devices.results] == [("lidar-0", True)]


@pytest.mark.parametrize(
    ("effect", "tolerations", "is_allocated"),
    [
        ("NoSchedule", [], False),
        ("NoExecute", [], False),
        ("None", [], True),
        ("NoSchedule", [{"operator": "Exists"}], True),
        ("NoSchedule", [{"key": "broken", "operator": "Equal", "value": "yes"}], True),
        ("NoSchedule", [{"key": "broken", "value": "no"}], False),
        ("NoExecute", [{"key": "broken", "operator": "Exists", "effect": "NoSchedule"}], False),
    ],
)
def test_taints_must_be_tolerated(effect: str, tolerations: list[dict[str, str]], *, is_allocated: bool) -> None:
    device = make_device("d", taints=[{"key": "broken", "value": "yes", "effect": effect}])
    claim = make_resource_claim(make_request("r", tolerations=tolerations))
    allocations = allocate(make_inventory(make_slice(device)), claim)
    assert (allocations is not None) == is_allocated
    if allocations is not None:
        assert len(allocations[0].devices.results[0].tolerations) == len(tolerations)


@pytest.mark.parametrize(
    "fields",
    [
        {"consumesCounters": [{"counterSet": "gpu", "counters": {"slices": {"value": "1"}}}]},
        {"allowMultipleAllocations": True},
        {"bindingConditions": ["attached"], "bindingFailureConditions": ["failed"]},
    ],
)
def test_devices_of_kinds_that_are_not_served_stay_free_and_the_reason_says_so(fields: dict[str, object]) -> None:
    inventory = make_inventory(make_slice(make_device("part", **fields)))
    with pytest.raises(NodeAllocationError, match=r"robot-1/part is not served by this scheduler: it is"):
        allocate(inventory, make_resource_claim(make_request()))
    inventory.apply_slice(make_slice("whole", name="more", pool="z"))
    assert names_of(allocate(inventory, make_resource_claim(make_request()))) == [["whole"]]


def test_invalid_pools_are_named_only_where_nothing_else_helps() -> None:
    inventory = make_inventory(make_slice("twin", "twin"))
    with pytest.raises(NodeAllocationError, match="invalid resource pools were encountered"):
        allocate(inventory, make_resource_claim(make_request()))


@pytest.mark.parametrize(
    ("request_fields", "message"),
    [
        (
            {"deviceClassName": "gone"},
            'could not retrieve device class gone: deviceclass.resource.k8s.io "gone" not found',
        ),
        ({"deviceClassName": ""}, "missing device class name"),
        ({"allocationMode": "Some"}, "unsupported count mode Some"),
        ({"capacity": {"requests": {"memory": "1Gi"}}}, "does not share devices by capacity"),
        ({"selectors": [{"newer": {}}]}, "selector #0: CEL expression empty"),
        ({"derivedAttributes": [{"name": "a/b", "expression": "1"}]}, "derived attributes, the feature is disabled"),
    ],
)
def test_requests_that_no_node_can_serve_are_refused(request_fields: dict[str, object], message: str) -> None:
    claim = make_resource_claim({"name": "r", "exactly": {**make_requirements(), **request_fields}})
    with pytest.raises(AllocationError, match=f"claim ns/claim, request r.*{message}"):
        allocate(make_inventory(SENSORS), claim)


def test_a_selector_that_fails_on_a_device_names_the_device_and_the_cure() -> None:
    claim = make_resource_claim(make_request("r", 'device.attributes["devices.example.com"].speed > 3'))
    with pytest.raises(
        AllocationError, match=r"claim ns/claim: selector #0 on device .*/cam-0: CEL runtime error: no such key"
    ):
        allocate(make_inventory(SENSORS), claim)


def test_a_selector_of_a_class_is_tried_first_and_named_as_such() -> None:
    broken = make_class("broken", "device.driver")
    claim = make_resource_claim(make_request("r", "device.foo", deviceClassName="broken"))
    with pytest.raises(AllocationError, match=r"class broken: selector #0 on device .*could not be converted to bool"):
        allocate(make_inventory(SENSORS), claim, classes=(broken,))


def test_a_device_in_use_is_not_even_shown_to_selectors() -> None:
    claim = make_resource_claim(make_request("r", 'device.attributes["devices.example.com"].bus == 1'))
    inventory = make_inventory(make_slice("odd", make_device("even", attributes={"bus": 1})))
    assert names_of(allocate(inventory, claim, allocated={"odd"})) == [["even"]]
    with pytest.raises(AllocationError):
        allocate(inventory, claim)


def test_a_search_that_takes_too_long_is_given_up_on_this_node_with_the_cure() -> None:
    grid = make_slice(*(make_device(f"d{i}", attributes={"row": i // 10, "column": i % 10}) for i in range(100)))
    same_place = [{"matchAttribute": f"devices.example.com/{attribute}"} for attribute in ("row", "column")]
    claim = make_resource_claim(make_request("r", count=2), constraints=same_place)
    with pytest.raises(SearchTooLongError, match="too many combinations of devices were tried; fewer requests"):
        allocate(make_inventory(grid), claim)


BUSES = make_slice(*(make_device(f"d{i}", attributes={"bus": i // 3}) for i in range(31)))
ONE_BUS = [{"matchAttribute": "devices.example.com/bus"}]
DIFFERENT_BUSES = [{"distinctAttribute": "devices.example.com/bus"}]


@pytest.mark.parametrize(
    "claims",
    [
        [make_resource_claim(*(make_request(f"r{i}") for i in range(32)))],
        [make_resource_claim(*(make_request(f"r{i}") for i in range(4)), constraints=ONE_BUS)],
        [make_resource_claim(make_request("r", count=4), constraints=ONE_BUS)],
        [make_resource_claim(make_request("r", count=12), constraints=DIFFERENT_BUSES)],
        [
            make_resource_claim(
                make_request("r", count=16), constraints=[{"matchAttribute": "devices.example.com/absent"}]
            )
        ],
        [make_resource_claim(make_request("r", count=9), name=name) for name in ("a", "b", "c", "d")],
        [
            make_resource_claim(*(make_request(f"r{i}") for i in range(16)), name="large"),
            make_resource_claim(make_request("r", "false"), name="hopeless"),
        ],
    ],
)
def test_claims_that_cannot_be_served_are_seen_as_such_before_all_ways_are_tried(claims: list[ResourceClaim]) -> None:
    assert allocate(make_inventory(BUSES), *claims, extra_steps=800) is None


def test_a_request_that_fails_is_not_tried_again_for_choices_that_make_no_difference() -> None:
    devices = (make_device(f"d{i}", attributes={"bus": i, "type": "lidar" if i < 2 else "camera"}) for i in range(30))
    text = 'device.attributes["devices.example.com"].type == "lidar"'
    pair = [{"matchAttribute": "devices.example.com/bus", "requests": ["x", "y"]}]
    requests = [make_request("free", count=5), make_request("x", text), make_request("y", text)]
    claim = make_resource_claim(*requests, constraints=[*pair, {"distinctAttribute": "devices.example.com/bus"}])
    assert allocate(make_inventory(make_slice(*devices)), claim, extra_steps=800) is None


def test_what_selectors_cost_counts_as_steps() -> None:
    numbers = f"[{', '.join(map(str, range(20)))}]"
    claim = make_resource_claim(make_request("r", f"{numbers}.all(x, {numbers}.all(y, x + y >= 0))"))
    inventory = make_inventory(make_slice(*(f"d{i}" for i in range(20))))
    with pytest.raises(SearchTooLongError):
        allocate(inventory, claim, extra_steps=0)
    assert names_of(allocate(inventory, claim, extra_steps=0)) == [["d0"]], "its verdict is kept"
    endless = make_resource_claim(make_request("r", f"{numbers}.all(x, {numbers}.all(y, {numbers}.all(z, true)))"))
    with pytest.raises(AllocationError, match="CEL runtime error: operation cancelled: actual cost limit exceeded"):
        allocate(inventory, endless)


def test_claims_may_need_more_devices_than_python_allows_calls_in_calls() -> None:
    inventory = make_inventory(*(make_slice(*(f"d{i}" for i in range(128)), pool=f"p{n}") for n in range(12)))
    claims = [make_resource_claim(make_request("r", count=32), name=f"c{n}") for n in range(40)]
    allocations = allocate(inventory, *claims)
    assert allocations is not None
    assert len({(r.pool, r.device) for a in allocations for r in a.devices.results}) == 40 * 32
