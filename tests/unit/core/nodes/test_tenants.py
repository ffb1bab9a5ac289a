"""Which nodes a namespace may use: the annotation of one computer holds for its whole robot."""

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.instances import closed_nodes
from robotapp_claims.rules.objects import Meta
from robotapp_scheduler.core.nodes.tenants import Tenants

ALLOWED = str(Annotation.ALLOWED_NAMESPACES)


def apply(tenants: Tenants, name: str, *, robot: str = "", allowed: str | None = None) -> bool:
    labels = {str(Label.ROBOT): robot} if robot else {}
    return tenants.apply(name, labels, {} if allowed is None else {ALLOWED: allowed})


def test_without_annotations_every_node_is_open_and_nothing_is_news() -> None:
    tenants = Tenants()
    assert not apply(tenants, "n1", robot="a")
    assert tenants.closed_to("team") == frozenset()
    assert not tenants.remove("n1")


def test_one_annotated_computer_closes_the_whole_robot_and_no_other() -> None:
    tenants = Tenants()
    apply(tenants, "n1", robot="a")
    assert apply(tenants, "n2", robot="a", allowed="team-a, team-b")
    apply(tenants, "n3", robot="b")
    assert tenants.closed_to("team-c") == {"n1", "n2"}
    assert tenants.closed_to("team-b") == frozenset()
    assert apply(tenants, "n4", robot="a"), "a computer that joins is closed, too"
    assert tenants.closed_to("team-c") == {"n1", "n2", "n4"}


def test_computers_that_admit_different_namespaces_admit_together_those_that_both_do() -> None:
    tenants = Tenants()
    apply(tenants, "n1", robot="a", allowed="x,y")
    apply(tenants, "n2", robot="a", allowed="y,z")
    assert [bool(tenants.closed_to(team)) for team in "xyz"] == [True, False, True]


def test_an_empty_annotation_admits_nobody_and_holds_for_a_node_that_is_no_robot() -> None:
    tenants = Tenants()
    assert apply(tenants, "edge", allowed="")
    assert tenants.closed_to("team") == {"edge"}


def test_a_node_that_goes_changes_robot_or_drops_its_annotation_opens_what_it_closed() -> None:
    for way in ("gone", "another robot", "open"):
        tenants = Tenants()
        apply(tenants, "n1", robot="a")
        apply(tenants, "n2", robot="a", allowed="other")
        assert tenants.closed_to("team") == {"n1", "n2"}
        match way:
            case "gone":
                assert tenants.remove("n2")
            case "another robot":
                assert apply(tenants, "n2", robot="b", allowed="other")
            case _:
                assert apply(tenants, "n2", robot="a")
        assert "n1" not in tenants.closed_to("team"), way
        assert not apply(tenants, "n1", robot="a"), "a heartbeat is no news"


def test_scheduler_and_operator_close_the_same_nodes() -> None:
    tenants = Tenants()
    metas = []
    cases = [
        ("n1", "a", None),
        ("n2", "a", "x"),
        ("n3", "b", "x,y"),
        ("n4", "", "y"),
        ("n5", "", None),
        ("n6", "c", ""),
    ]
    for name, robot, allowed in cases:
        apply(tenants, name, robot=robot, allowed=allowed)
        annotations = {} if allowed is None else {ALLOWED: allowed}
        metas.append(Meta(name=name, labels={str(Label.ROBOT): robot} if robot else {}, annotations=annotations))
    for team in ("x", "y", "z"):
        assert tenants.closed_to(team) == closed_nodes(metas, team)
