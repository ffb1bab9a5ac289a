"""Which nodes exchange messages: remaps, namespaces, parameters and includes resolved, on small workspaces of our own."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from tests.support.ros_sources import graph, package, python_node, setup_py, triples, write

from ros_profile.decide.edges import graph_name
from ros_profile.decide.launching import absolute

TALK = python_node("talk", "self.create_publisher(String, 'chat', 10)", "self.create_client(Trigger, '~/reset')")
HEAR = python_node(
    "hear", "self.create_subscription(String, 'chat', f, 10)", "self.create_service(Trigger, 'reset', f)"
)


def pair(root: Path, launch: str, file: str = "launch/a.launch.py") -> Path:
    package(root, "duo", {**TALK, **HEAR, **setup_py("talk", "hear"), file: launch})
    return root


def test_a_publisher_and_a_subscription_of_one_name_are_an_edge(tmp_path: Path) -> None:
    pair(
        tmp_path,
        """
        def generate_launch_description():
            return LaunchDescription([Node(package='duo', executable='talk'), Node(package='duo', executable='hear')])
    """,
    )
    assert triples(tmp_path, "duo/launch/a.launch.py") == {("/chat", "/talk", "/hear")}


def test_namespaces_part_and_remaps_join(tmp_path: Path) -> None:
    pair(
        tmp_path,
        """
        def generate_launch_description():
            return LaunchDescription([
                Node(package='duo', executable='talk', namespace='a'),
                Node(package='duo', executable='talk', name='other', namespace='b', remappings=[('chat', '/a/chat')]),
                Node(package='duo', executable='hear', namespace='a'),
                Node(package='duo', executable='hear', namespace='c')])
    """,
    )
    assert triples(tmp_path, "duo/launch/a.launch.py") == {
        ("/a/chat", "/a/talk", "/a/hear"),
        ("/a/chat", "/b/other", "/a/hear"),
    }


def test_private_names_are_below_the_node_and_services_go_from_client_to_server(tmp_path: Path) -> None:
    pair(
        tmp_path,
        """
        <launch>
          <node pkg="duo" exec="talk" name="t"><remap from="~/reset" to="/h/reset"/></node>
          <node pkg="duo" exec="hear" name="x" namespace="/h"/>
        </launch>
    """,
        "launch/a.launch.xml",
    )
    found = graph(tmp_path, "duo/launch/a.launch.xml")
    assert [(edge.kind, edge.topic, edge.source, edge.target) for edge in found] == [
        ("Service", "/h/reset", "/t", "/h/x")
    ]


def test_included_files_get_arguments_namespace_and_remaps(tmp_path: Path) -> None:
    package(
        tmp_path,
        "top",
        {
            "launch/all.launch.py": """
        def generate_launch_description():
            return LaunchDescription([
                GroupAction([PushRosNamespace('bot'), SetRemap('chat', 'talking'), IncludeLaunchDescription(
                    PythonLaunchDescriptionSource([FindPackageShare('duo'), '/launch/a.launch.py']),
                    launch_arguments=[('hear', 'true')])])])
    """
        },
    )
    pair(
        tmp_path,
        """
        def generate_launch_description():
            return LaunchDescription([
                DeclareLaunchArgument('hear', default_value='false'),
                Node(package='duo', executable='talk'),
                Node(package='duo', executable='hear', condition=IfCondition(LaunchConfiguration('hear')))])
    """,
    )
    assert triples(tmp_path, "top/launch/all.launch.py") == {("/bot/talking", "/bot/talk", "/bot/hear")}
    assert triples(tmp_path, "duo/launch/a.launch.py") == set(), "the default starts one node only"


def test_a_topic_named_by_a_parameter_takes_the_launch_files_value_then_the_files_then_the_default(
    tmp_path: Path,
) -> None:
    files = python_node("cam", "self.create_publisher(Image, self.declare_parameter('topic', 'image').value, 1)")
    sink = python_node(
        "view", "for_all = 1", *(f"self.create_subscription(Image, '{t}', f, 1)" for t in ("image", "filed", "given"))
    )
    package(
        tmp_path,
        "vision",
        {
            **files,
            **sink,
            **setup_py("cam", "view"),
            "config/cam.yaml": "/second:\n  ros__parameters:\n    topic: filed\n",
            "launch/a.launch.py": """
            def generate_launch_description():
                cfg = PathJoinSubstitution([FindPackageShare('vision'), 'config', 'cam.yaml'])
                return LaunchDescription([
                    Node(package='vision', executable='view'),
                    Node(package='vision', executable='cam', name='first'),
                    Node(package='vision', executable='cam', name='second', parameters=[cfg]),
                    Node(package='vision', executable='cam', name='third', parameters=[cfg, {'topic': 'given'}])])
        """,
        },
    )
    assert triples(tmp_path, "vision/launch/a.launch.py") == {
        ("/image", "/first", "/view"),
        ("/filed", "/second", "/view"),
        ("/given", "/third", "/view"),
    }


def test_different_types_on_one_topic_are_no_edge(tmp_path: Path) -> None:
    package(
        tmp_path,
        "odd",
        {
            **python_node("one", "self.create_publisher(String, 'x', 1)"),
            **python_node("two", "self.create_subscription(Image, 'x', f, 1)"),
            **setup_py("one", "two"),
            "launch/a.launch.xml": '<launch><node pkg="odd" exec="one"/><node pkg="odd" exec="two"/></launch>',
        },
    )
    assert graph(tmp_path, "odd/launch/a.launch.xml") == []


def test_ros_1_gives_included_files_only_what_is_passed(tmp_path: Path) -> None:
    script = "#!/usr/bin/env python\nimport rospy\nfrom std_msgs.msg import String\nrospy.init_node('n')\n"
    package(
        tmp_path,
        "old",
        {
            "scripts/talk.py": script + "rospy.Publisher('chat', String)\n",
            "scripts/hear.py": script + "rospy.Subscriber('chat', String, f)\n",
            "launch/all.launch": """
            <launch><arg name="ns" default="outer"/>
              <group ns="g"><include file="$(find old)/launch/one.launch"/></group>
              <include file="$(find old)/launch/one.launch"><arg name="ns" value="given"/></include></launch>
        """,
            "launch/one.launch": """
            <launch><arg name="ns" default="inner"/>
              <node pkg="old" type="talk.py" name="t" ns="$(arg ns)"/>
              <node pkg="old" type="hear.py" name="h" ns="$(arg ns)"/></launch>
        """,
        },
        ros=1,
    )
    assert triples(tmp_path, "old/launch/all.launch") == {
        ("/g/inner/chat", "/g/inner/t", "/g/inner/h"),
        ("/given/chat", "/given/t", "/given/h"),
    }


def test_files_that_include_each_other_end_with_a_problem(tmp_path: Path) -> None:
    from ros_profile.generate import generate_profile

    include = '<launch><node pkg="p" exec="e"/><include file="$(find-pkg-share loop)/launch/{}.launch.xml"/></launch>'
    package(tmp_path, "loop", {"launch/a.launch.xml": include.format("b"), "launch/b.launch.xml": include.format("a")})
    launches = generate_profile(tmp_path, engine="none").packages[0].launches
    assert all("includes itself" in launch.problems[0].message for launch in launches)
    assert [len(launch.nodes) for launch in launches] == [2, 2]


NAMES = st.from_regex(r"\A[a-z]{1,3}(/[a-z]{1,3}){0,2}\Z")


@given(NAMES, NAMES, NAMES)
def test_a_remap_of_a_relative_name_is_one_of_the_full_name(name: str, target: str, namespace: str) -> None:
    node = absolute("n", f"/{namespace}")
    relative = graph_name(name, node, f"/{namespace}", ((name, target),))
    full = graph_name(
        absolute(name, f"/{namespace}"), node, f"/{namespace}", ((absolute(name, f"/{namespace}"), target),)
    )
    assert relative == full == f"/{namespace}/{target}"


def test_a_package_outside_the_workspace_is_named(tmp_path: Path) -> None:
    from ros_profile.generate import generate_profile

    write(
        package(tmp_path, "top", {}),
        {"launch/a.launch.xml": '<launch><include file="$(find-pkg-share nav2_bringup)/launch/x.launch.py"/></launch>'},
    )
    launch = generate_profile(tmp_path, engine="none").packages[0].launches[0]
    assert [problem.message for problem in launch.problems] == [
        "includes nav2_bringup/launch/x.launch.py, which is not in the workspace"
    ]
