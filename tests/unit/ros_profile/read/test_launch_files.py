"""What is read from launch files in the three formats, before includes are followed."""

import pytest
from tests.support.ros_sources import launch

NODE = {
    "a.launch.py": """
        def generate_launch_description():
            return LaunchDescription([
                DeclareLaunchArgument('ns', default_value='robot'),
                Node(package='p', executable='e', name='n', namespace=LaunchConfiguration('ns'),
                     remappings=[('scan', '/front/scan')], parameters=[{'rate': 20.0}, 'cfg.yaml'],
                     condition=UnlessCondition(LaunchConfiguration('off'))),
            ])
    """,
    "a.launch.xml": """
        <launch>
          <arg name="ns" default="robot"/>
          <node pkg="p" exec="e" name="n" namespace="$(var ns)" unless="$(var off)">
            <remap from="scan" to="/front/scan"/><param name="rate" value="20.0"/><param from="cfg.yaml"/>
          </node>
        </launch>
    """,
    "a.launch.yaml": """
        launch:
        - arg: {name: ns, default: robot}
        - node:
            pkg: p
            exec: e
            name: n
            namespace: $(var ns)
            unless: $(var off)
            remap: [{from: scan, to: /front/scan}]
            param: [{name: rate, value: 20.0}, {from: cfg.yaml}]
    """,
    "a.launch": """
        <launch>
          <arg name="ns" default="robot"/>
          <group unless="$(var off)">
            <node pkg="p" type="e" name="n" ns="$(var ns)">
              <remap from="scan" to="/front/scan"/><param name="rate" value="20.0"/><rosparam file="cfg.yaml"/>
            </node>
          </group>
        </launch>
    """,
}


@pytest.mark.parametrize("file", NODE)
def test_a_node_reads_the_same_in_every_format(file: str) -> None:
    found = launch(NODE[file], file)
    node = found.nodes[0]
    assert (node.package, node.executable, node.name, node.namespace) == ("p", "e", "n", "$(var ns)")
    assert node.remaps == (("scan", "/front/scan"),)
    assert node.parameters == (("rate", "20.0"),)
    assert node.parameter_files == ("cfg.yaml",)
    assert node.conditions == ("not $(var off)",)
    assert [(argument.name, argument.default) for argument in found.arguments] == [("ns", "robot")]
    assert found.problems == ()


def test_groups_give_namespace_remaps_and_condition_to_what_stands_in_them_only() -> None:
    found = launch("""
        def generate_launch_description():
            ld = LaunchDescription()
            ld.add_action(GroupAction(condition=IfCondition('$x'), actions=[
                PushRosNamespace('arm'), SetRemap('a', 'b'), Node(package='p', executable='one', namespace='left')]))
            ld.add_action(Node(package='p', executable='two'))
            return ld
    """)
    one, two = found.nodes
    assert (one.namespace, one.remaps, one.conditions) == ("arm/left", (("a", "b"),), ("$x",))
    assert (two.namespace, two.remaps, two.conditions) == ("", (), ())


def test_composable_nodes_know_their_container() -> None:
    found = launch("""
        def generate_launch_description():
            container = ComposableNodeContainer(name='box', package='rclcpp_components', executable='component_container',
                composable_node_descriptions=[ComposableNode(package='p', plugin='p::A', name='a')])
            later = LoadComposableNodes(target_container='box', composable_node_descriptions=[
                ComposableNode(package='q', plugin='q::B')])
            return LaunchDescription([container, later])
    """)
    assert [(node.plugin, node.container) for node in found.nodes] == [("", ""), ("p::A", "box"), ("q::B", "box")]


def test_loops_functions_and_opaque_functions_are_followed() -> None:
    found = launch("""
        def camera(name, ns='cams'):
            return Node(package='cam', executable='driver', name=name, namespace=ns)
        def setup(context, *args):
            if LaunchConfiguration('lidar').perform(context) == 'yes':
                return [Node(package='lidar', executable='driver')]
            return []
        def generate_launch_description():
            nodes = [camera(side) for side in ('left', 'right')]
            for index in range_of_cameras:
                nodes.append(camera('extra'))
            return LaunchDescription([*nodes, OpaqueFunction(function=setup)])
    """)
    assert [(node.name, node.namespace) for node in found.nodes] == [
        ("left", "cams"),
        ("right", "cams"),
        ("extra", "cams"),
        ("", ""),
    ]
    assert found.nodes[-1].conditions == ("$(equals $(var lidar) | yes)",)


def test_values_that_depend_on_an_argument_keep_both_sides() -> None:
    found = launch("""
        def setup(context):
            topic = 'raw'
            if LaunchConfiguration('rectify'):
                topic = 'rect'
            return [Node(package='p', executable='e', remappings=[('in', topic)])]
        def generate_launch_description():
            return LaunchDescription([OpaqueFunction(function=setup)])
    """)
    assert found.nodes[0].remaps == (("in", "$(if $(var rectify) | rect | raw)"),)


def test_includes_carry_arguments_and_paths() -> None:
    found = launch("""
        def generate_launch_description():
            base = os.path.join(get_package_share_directory('robot'), 'launch')
            return LaunchDescription([IncludeLaunchDescription(
                PythonLaunchDescriptionSource(PathJoinSubstitution([base, 'base.launch.py'])),
                launch_arguments={'ns': 'a'}.items())])
    """)
    assert found.includes[0].target == "$(find robot)/launch/base.launch.py"
    assert found.includes[0].arguments == (("ns", "a"),)


def test_nodelets_are_composable_nodes_of_their_manager() -> None:
    found = launch(
        '<launch><node pkg="nodelet" type="nodelet" name="r" args="load image_proc/rectify mgr"/></launch>', "a.launch"
    )
    node = found.nodes[0]
    assert (node.package, node.plugin, node.container) == ("image_proc", "image_proc/rectify", "mgr")


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("a.launch", "<!DOCTYPE x [<!ENTITY e SYSTEM 'file:///etc/passwd'>]><launch><node pkg='&e;'/></launch>"),
        ("a.launch", "<launch>" * 500),
        ("a.launch", "no xml at all"),
        ("a.launch.yaml", "launch: &a [*a]"),
        ("a.launch.yaml", "launch: " + "[" * 500),
        ("a.launch.py", "def generate_launch_description():\n    return generate_launch_description()"),
        ("a.launch.py", "def generate_launch_description(:"),
    ],
)
def test_hostile_launch_files_start_nothing(file: str, text: str) -> None:
    found = launch(text, file)
    assert found.nodes == ()


def test_functions_that_call_each_other_end() -> None:
    found = launch("""
        def a(): return [Node(package='p', executable='e'), b()]
        def b(): return a() + a()
        def generate_launch_description():
            return LaunchDescription(a())
    """)
    assert len(found.nodes) <= 1000


@pytest.mark.parametrize(
    "start", ["", "\n\n", '<?xml version="1.0"?>\n\n', '\n\n<?xml version="1.0"?>\n', "\n<!-- a\n-->"]
)
def test_lines_are_those_of_the_file_whatever_stands_before_the_first_element(start: str) -> None:
    text = f'{start}<launch>\n<node pkg="a" exec="b"/></launch>'
    (node,) = launch(text, "a.launch.xml").nodes
    assert node.line == text[: text.index("<node")].count("\n") + 1
