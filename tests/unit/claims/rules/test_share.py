import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_claims.rules.objects import App, AppSpec, Meta, Ros2, SharedApp
from robotapp_claims.rules.share import owner_of, sharer_instance


def world(**shares: str) -> dict[tuple[str, str], App]:
    """`b="a"`: app b of namespace team joins a; `x/c` is app c of namespace x."""
    apps = {}
    for name, wanted in shares.items():
        namespace, _, short = name.rpartition("__")
        others = tuple(
            SharedApp(name=other.rpartition("/")[2], namespace=other.rpartition("/")[0]) for other in wanted.split()
        )
        meta = Meta(name=short, namespace=namespace or "team", uid=name)
        apps[meta.namespace, short] = App(metadata=meta, spec=AppSpec(ros2=Ros2(share_with=others)))
    return apps


@pytest.mark.parametrize(
    ("apps", "owner"),
    [
        (world(b=""), "b"),
        (world(b="a", a=""), "a"),
        (world(b="a", a="b"), "a"),
        (world(b="c", c="a", a=""), "a"),
        (world(b="c", c="d", d="c", a=""), "c"),
        (world(b="a c", a="", c="a"), "a"),
        (world(b="a c", a="b", c="b"), "a"),
    ],
)
def test_shared_domains_have_one_owner_that_all_agree_on(apps: dict[tuple[str, str], App], owner: str) -> None:
    assert owner_of(apps["team", "b"], apps.get).owner == ("team", owner)


@pytest.mark.parametrize(
    ("apps", "text"),
    [
        (world(b="a"), "does not exist"),
        (world(b="x/a", x__a=""), "no such app that names team/b"),
        (world(b="a c", a="", c=""), "different domains: team/a, team/c"),
    ],
)
def test_a_join_that_nobody_can_follow_says_why(apps: dict[tuple[str, str], App], text: str) -> None:
    join = owner_of(apps["team", "b"], apps.get)
    assert join.owner is None
    assert text in join.message


@pytest.mark.parametrize("theirs", ["", "c/d", "x/b"], ids=["names nobody", "names another", "names its own"])
def test_an_app_of_another_namespace_that_does_not_admit_reads_like_none(theirs: str) -> None:
    absent, present = world(b="x/a"), world(b="x/a", x__a=theirs)
    message = owner_of(present["team", "b"], present.get).message
    assert message == owner_of(absent["team", "b"], absent.get).message
    assert "both must name each other" in message


def test_another_namespace_is_joined_when_both_say_so() -> None:
    apps = world(b="x/a", x__a="team/b")
    assert owner_of(apps["team", "b"], apps.get) == owner_of(apps["x", "a"], apps.get)


@given(st.dictionaries(st.sampled_from("abcdef"), st.lists(st.sampled_from("abcdef"), max_size=3, unique=True)))
def test_any_web_of_shares_gets_an_answer(shares: dict[str, list[str]]) -> None:
    apps = world(**{name: " ".join(others) for name, others in shares.items()})
    for app in apps.values():
        join = owner_of(app, apps.get)
        assert (join.owner is None) == bool(join.message)


@pytest.mark.parametrize(
    ("mine", "owners", "joined"),
    [("amr-1", ("amr-1", "amr-2"), "amr-1"), ("amr-3", ("amr-1", "amr-2"), None), ("amr-3", ("",), ""), ("", (), None)],
)
def test_an_instance_joins_the_same_robots_instance_or_the_only_one(
    mine: str, owners: tuple[str, ...], joined: str | None
) -> None:
    assert sharer_instance(mine, owners) == joined
