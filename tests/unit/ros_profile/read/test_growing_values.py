"""Small launch files whose values double with every line: what they stand for ends at a bound, in memory and in time."""

import time
import tracemalloc

import pytest
from tests.support.work_unit import is_within

from ros_profile.decide.edges import MAX_EDGES, Ends, _Patterns, edges
from ros_profile.decide.launching import Launched
from ros_profile.decide.substitution import truth
from ros_profile.model.conclusions import GraphName
from ros_profile.model.endpoints import Role
from ros_profile.model.launch import UNKNOWN_TEXT, LaunchFile, StartedNode
from ros_profile.read.launch.python import read_launch_python
from ros_profile.read.python.source import read_python

NODE = "Node(package='demo', executable='x')"
TEXT = "LaunchConfiguration('x')"


def read(*lines: str) -> LaunchFile:
    body = "".join(f"    {line}\n" for line in lines)
    return read_launch_python(f"def generate_launch_description():\n{body}".encode(), "a.launch.py")


@pytest.mark.parametrize(
    ("first", "doubling"),
    [
        ("a = 'xxxxxxxx'", "a = f'{a}{a}'"),
        ("a = 'xxxxxxxx'", "a = [a, a]"),
        (f"a = [{NODE}]", "a = [*a, *a]"),
        (f"a = [{NODE}]", "a.extend(a)"),
        ("a = []", "a = [a, a]"),
        ("a = GroupAction([])", "a = GroupAction([a, a])"),
        ("a = {'x': 1}", "a = {'x': a, 'y': a}"),
        ("a = []", "b = []; b.append(a); b.append(a); a = b"),
        (f"a = {TEXT}", "a = a or a"),
        ("a = []", "a = [a for i in [1, 2]]"),
    ],
)
def test_values_that_double_with_every_line_end_at_a_bound(first: str, doubling: str) -> None:
    tracemalloc.start()
    try:
        begun = time.process_time()
        last = "return LaunchDescription([a, Node(package='demo', executable=a, parameters=[a, {'p': a}])])"
        found = read(first, *[doubling] * 60, last)
        assert is_within(time.process_time() - begun, 10), "without a bound: for ever"
        assert tracemalloc.get_traced_memory()[1] < 50_000_000
    finally:
        tracemalloc.stop()
    assert found.problems or len(found.nodes) == 1


def test_a_function_with_two_results_doubles_no_list_without_end() -> None:
    text = "def twice(x):\n    if unknown:\n        return x\n    return x\n"
    body = f"    a = [{NODE}]\n" + "    a = twice(a)\n" * 60 + "    return LaunchDescription(a)\n"
    found = read_launch_python(f"{text}def generate_launch_description():\n{body}".encode(), "a.launch.py")
    assert found.problems or found.nodes


def test_many_names_and_many_branches_cost_no_product_of_both() -> None:
    names = [f"x{number} = 1" for number in range(20_000)]
    begun = time.process_time()
    read(*names)
    names_alone_s = time.process_time() - begun
    begun = time.process_time()
    found = read(*names, *["if unknown: pass"] * 20_000)
    assert is_within(time.process_time() - begun, 20 * names_alone_s + 1)
    assert "is larger than is followed" in found.problems[0].message


@pytest.mark.parametrize("name", ["/n{}", "/same"])
def test_many_nodes_with_many_topics_are_not_all_compared(name: str) -> None:
    graph = tuple(
        GraphName(role.value, f"/t{n}", "a/B") for n in range(300) for role in (Role.PUBLISHER, Role.SUBSCRIPTION)
    )
    launched = Launched(
        StartedNode("demo", "x"), "demo", "/", "n", "", (), (), (), certain=True, file="demo/a", values={}
    )
    nodes = [Ends(launched, name.format(number), graph) for number in range(500)]
    begun = time.process_time()
    found = edges(nodes)
    assert is_within(time.process_time() - begun, 10), "75 million pairs take a minute"
    assert len(found) == (MAX_EDGES if "{}" in name else 0)


@pytest.mark.parametrize(
    ("pattern", "name", "means"),
    [
        ("", "/a", True),
        ("/**", "/ns/a", True),
        ("a", "/ns/a", True),
        ("/ns/a", "/ns/a", True),
        ("/*/a", "/ns/a", True),
        ("/*/a", "/x/ns/a", False),
        ("/**/a", "/a", True),
        ("/**/a", "/x/ns/a", True),
        ("/ns/**", "/ns/x/a", True),
        ("/n*/a_*", "/ns/a_1", True),
        ("/n*/a_*", "/ns/b_1", False),
        ("/**/" * 49, "/" + "a/" * 120 + "b", False),
        ("/*a*a*a*a*a*a*a*a*a*a*a*a*a*a*a*a*b", "/" + "a" * 250, False),
    ],
)
def test_node_patterns_of_parameter_files_are_compared_without_trying_every_way(
    pattern: str, name: str, means: bool
) -> None:
    begun = time.process_time()
    assert _Patterns(name).mean(pattern) is means
    assert is_within(time.process_time() - begun, 5), "as a regular expression: for ever"


def test_only_so_many_patterns_are_compared_with_a_node() -> None:
    patterns = _Patterns("/ns/a")
    assert [patterns.mean(f"/{'*' * 2}/x{number}") for number in range(100)] == [False] * 100
    assert not patterns.mean("/*/a")
    assert patterns.mean("/ns/a")


def test_lines_of_a_source_that_name_each_other_fifty_times_end_at_a_bound() -> None:
    lines = [f"x{n} = [{', '.join([f'x{n + 1}'] * 50)}]" for n in range(6)]
    begun = time.process_time()
    read_python("\n".join([*lines, "x6 = 1", "self.declare_parameter('p', x0)"]).encode(), "a.py")
    assert is_within(time.process_time() - begun, 10), "without a bound: half an hour"


def test_a_number_that_python_does_not_write_is_unknown_and_the_rest_is_read() -> None:
    large = f"0x{'f' * 4000}"
    source = read_python(f"self.declare_parameter('p', {large})\nself.declare_parameter('q', 7)".encode(), "a.py")
    assert {each.name: each.default for each in source.parameters} == {"p": "", "q": "7"}
    found = read(
        f"return LaunchDescription([Node(package='demo', executable='x', parameters=[{{'p': {large}, 'q': 7}}])])"
    )
    (node,) = found.nodes
    assert dict(node.parameters) == {"p": UNKNOWN_TEXT, "q": "7"}


def test_a_condition_of_blanks_is_told_at_once() -> None:
    begun = time.process_time()
    for _ in range(20):
        assert truth("(" + " " * 1900 + "a" + " " * 90) is None
    assert is_within(time.process_time() - begun, 10), "before: twenty seconds each"


@pytest.mark.parametrize(
    ("text", "verdict"),
    [
        ("a == a", True),
        ("( 'a' == \"b\" )", False),
        ("((x!=y))", True),
        ("'' == ''", True),
        ("'true' == 1", True),
        ("'' != ''", False),
        ("a", None),
        ("a < b == c", None),
        ("a == b == c", None),
        ("a != '=='", None),
        ("not 'a' == 'a'", False),
    ],
)
def test_two_texts_are_compared_with_or_without_brackets_and_quotes(text: str, verdict: bool | None) -> None:
    assert truth(text) is verdict
