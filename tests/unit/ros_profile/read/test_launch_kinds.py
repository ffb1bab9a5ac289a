"""Launch files of the kinds that public repositories have: followed, or said to be not followed, never passed over in silence."""

from pathlib import Path

import pytest
from tests.support.ros_sources import launch, package

from ros_profile.decide.substitution import resolve
from ros_profile.files.load import load
from ros_profile.generate import generate_profile
from ros_profile.model.conclusions import LaunchProfile
from ros_profile.model.launch import LaunchFile

NODE = "Node(package='p', executable='e')"


def returned(text: str, before: str = "") -> LaunchFile:
    return launch(f"{before}\ndef generate_launch_description():\n    return {text}\n")


def told(found: LaunchFile) -> str:
    return "; ".join(problem.message for problem in found.problems)


def followed(root: Path, text: str, *, file: str = "a.launch.py", **others: str) -> LaunchProfile:
    package(root, "up", {f"launch/{file}": text, **{name.replace("__", "."): body for name, body in others.items()}})
    return next(one for one in generate_profile(root).packages[0].launches if one.file.endswith(file))


def test_a_description_of_a_class_of_the_file_is_read_like_its_base() -> None:
    found = returned(f"Ours([{NODE}])", "class Ours(LaunchDescription):\n    pass")
    assert len(found.nodes) == 1
    assert found.problems == ()


@pytest.mark.parametrize(
    ("text", "before"),
    [
        (f"far.OffloadLaunchDescription([{NODE}])", ""),
        (f"Ours([{NODE}])", "class Ours(far.OffloadLaunchDescription):\n    pass"),
        (f"Ours([{NODE}])", "class Ours(LaunchDescription):\n    def __init__(self, x):\n        self.more()"),
    ],
)
def test_a_description_of_a_foreign_class_is_read_and_what_it_may_add_is_told(text: str, before: str) -> None:
    found = returned(text, before)
    assert len(found.nodes) == 1
    assert "is read as a LaunchDescription; what its own code adds or changes is not followed" in told(found)


def test_a_node_of_a_foreign_class_is_read_as_a_node() -> None:
    found = returned("LaunchDescription([far.CloudNode(package='p', executable='e', machine=m)])")
    assert [(node.package, node.executable) for node in found.nodes] == [("p", "e")]
    assert "CloudNode is read as a Node" in told(found)


@pytest.mark.parametrize(
    "text",
    [
        "LaunchDescription(parts.talk())",
        f"LaunchDescription(parts.talk() + [{NODE}])",
        f"LaunchDescription([{NODE}, parts.talk()])",
        f"LaunchDescription([{NODE}, *parts.talk()])",
        f"LaunchDescription([GroupAction(parts.talk()), {NODE}])",
        f"LaunchDescription([OpaqueFunction(function=parts.talk), {NODE}])",
        "parts.talk()",
    ],
)
def test_a_function_of_another_module_is_named_as_not_followed(text: str) -> None:
    found = returned(text, "import parts")
    assert "what parts.talk(…) starts is not followed: it is defined elsewhere" in told(found)
    assert len(found.nodes) == ("Node" in text)


def test_nodes_added_to_what_is_no_description_are_told() -> None:
    found = launch(f"""
        def generate_launch_description():
            builder = far.Builder()
            builder.add_action({NODE})
            return builder
    """)
    assert "what is added to far.Builder(…) is not followed" in told(found)


def test_a_launch_file_that_starts_nothing_to_be_seen_says_why_when_an_app_is_made_of_it(tmp_path: Path) -> None:
    found = followed(tmp_path, "def generate_launch_description():\n    return parts.talk()\n")
    assert [problem.line for problem in found.problems] == [2]


def test_an_opaque_function_takes_its_keywords() -> None:
    found = returned(
        "LaunchDescription([OpaqueFunction(function=setup, args=['left'], kwargs={'params': {'rate': 20.0}})])",
        "def setup(context, ns, params, name='n'):\n"
        "    return [Node(package='p', executable='e', name=name, namespace=ns, parameters=[params])]",
    )
    (node,) = found.nodes
    assert (node.name, node.namespace, node.parameters) == ("n", "left", (("rate", "20.0"),))


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("EnvironmentVariable('X', default_value='')", ""),
        ("EnvironmentVariable('X', default_value='robot')", "robot"),
        ("os.environ.get('X', '')", ""),
        ("os.environ.get('X', 'robot')", "robot"),
        ("os.getenv('X', '')", ""),
        ("os.environ['X']", "$(?)"),
        ("os.environ.get('X')", "$(?)"),
        ("EnvironmentVariable('X')", "$(?)"),
    ],
)
def test_a_variable_of_the_environment_has_its_default(written: str, value: str) -> None:
    found = returned(f"LaunchDescription([DeclareLaunchArgument('ns', default_value={written})])")
    assert resolve(found.arguments[0].default or "", {}) == value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("$(env X '')", ""),
        ("$(env X robot)", "robot"),
        ("$(env X)", "$(?)"),
        ("$(optenv X)", ""),
        ("$(env X '')/a", "/a"),
    ],
)
def test_a_variable_of_an_xml_file_has_its_default(text: str, value: str) -> None:
    assert resolve(text, {}) == value


@pytest.mark.parametrize("file", ["a.launch.xml", "a.launch.py"])
def test_the_program_that_an_argument_names_is_started(tmp_path: Path, file: str) -> None:
    text = {
        "a.launch.xml": '<launch><arg name="x" default="run"/><node pkg="up" exec="$(var x)"/></launch>',
        "a.launch.py": """
            def generate_launch_description():
                return LaunchDescription([DeclareLaunchArgument('x', default_value='run'),
                                          Node(package='up', executable=LaunchConfiguration('x'))])
        """,
    }[file]
    assert [node.executable for node in followed(tmp_path, text, file=file).nodes] == ["run"]


ENVIRONMENT = {
    "a.launch.py": """
        def generate_launch_description():
            return LaunchDescription([SetEnvironmentVariable('A', '1'), GroupAction([SetEnvironmentVariable('B', '2')]),
                Node(package='p', executable='e', prefix='chrt -f 80', additional_env={'C': '3'})])
    """,
    "a.launch.xml": """
        <launch><set_env name="A" value="1"/><group><set_env name="B" value="2"/></group>
          <node pkg="p" exec="e" launch-prefix="chrt -f 80"><env name="C" value="3"/></node></launch>
    """,
    "a.launch.yaml": """
        launch:
        - set_env: {name: A, value: '1'}
        - group: [{set_env: {name: B, value: '2'}}]
        - node: {pkg: p, exec: e, launch-prefix: chrt -f 80, env: [{name: C, value: '3'}]}
    """,
}


@pytest.mark.parametrize("file", ENVIRONMENT)
def test_variables_reach_what_stands_after_them_in_the_same_scope(file: str) -> None:
    (node,) = launch(ENVIRONMENT[file], file).nodes
    assert node.environment == (("A", "1"), ("C", "3"))
    assert node.prefix == "chrt -f 80"


def test_variables_reach_included_files(tmp_path: Path) -> None:
    text = '<launch><set_env name="A" value="1"/><include file="$(find-pkg-share up)/launch/b.launch.xml"/></launch>'
    inner = {"launch/b.launch.xml": '<launch><node pkg="p" exec="e"/></launch>'}
    (node,) = followed(tmp_path, text, file="a.launch.xml", **inner).nodes
    assert node.environment == (("A", "1"),)


@pytest.mark.parametrize(
    ("tag", "message"),
    [
        ('<machine name="m" address="10.0.0.2"/>', "<machine> is not followed: write runsOn"),
        ('<node pkg="p" type="e" machine="m"/>', "machine m is not followed; write runsOn"),
        ('<executable cmd="gzserver world.sdf"/>', "a process that is no node gets no component: gzserver world.sdf"),
        ('<set_parameter name="use_sim_time" value="true"/>', "write the parameter for each node"),
        ('<unset_env name="A"/>', "<unset_env> is not followed"),
    ],
)
def test_a_tag_that_is_not_followed_is_told_with_its_line(tag: str, message: str) -> None:
    found = launch(f"<launch>\n  {tag}\n</launch>", "a.launch.xml")
    assert message in told(found)
    assert found.problems[0].line == 2


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ("ExecuteProcess(cmd=['gzserver', world])", "a process that is no node gets no component: gzserver"),
        ("SetParameter(name='use_sim_time', value=True)", "parameter use_sim_time is set for all nodes"),
        ("AppendEnvironmentVariable('PATH', '/x')", "what is appended to the variable PATH"),
    ],
)
def test_an_action_that_is_not_followed_is_told(action: str, message: str) -> None:
    assert message in told(returned(f"LaunchDescription([{action}])"))


@pytest.mark.parametrize("action", ["LogInfo(msg='x')", "Shutdown()", "EmitEvent(event=Shutdown())"])
def test_an_action_that_starts_nothing_is_no_problem(action: str) -> None:
    assert returned(f"LaunchDescription([{action}])").problems == ()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("bringup.xml", '<?xml version="1.0"?>\n<!-- <x/> -->\n<launch><node pkg="p" exec="e"/></launch>'),
        ("start.yaml", "%YAML 1.2\n---\nlaunch:\n# nodes\n- node: {pkg: p, exec: e}\n"),
        ("start.py", f"def generate_launch_description():\n    return LaunchDescription([{NODE}])\n"),
    ],
)
def test_a_launch_file_of_any_name_is_included(tmp_path: Path, name: str, text: str) -> None:
    outer = f'<launch><include file="$(find-pkg-share up)/parts/{name}"/></launch>'
    package(tmp_path, "up", {"launch/a.launch.xml": outer, f"parts/{name}": text})
    (found,) = [one for one in generate_profile(tmp_path).packages[0].launches if one.file.endswith("a.launch.xml")]
    assert [node.executable for node in found.nodes] == ["e"]
    assert found.problems == ()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("c.yaml", "launch:\n  ros__parameters:\n    x: 1\n"),
        ("c.xml", "<robot><launch/></robot>"),
        ("d.xml", "<!-- <launch> -->\n<library/>"),
        ("e.xml", "<!--" * 2000),
    ],
)
def test_other_files_are_no_launch_files(tmp_path: Path, name: str, text: str) -> None:
    package(tmp_path, "up", {name: text})
    assert load(tmp_path).packages[0].launch_files == ()


def test_absolute_paths_are_no_files_of_the_package(tmp_path: Path) -> None:
    text = (
        '<launch><node pkg="p" exec="e"><param from="/etc/robot/talk.yaml"/></node>'
        '<include file="/opt/robot/b.launch.xml"/></launch>'
    )
    found = followed(tmp_path, text, file="a.launch.xml")
    assert found.nodes[0].parameter_files == ("/etc/robot/talk.yaml",)
    assert "it is named by an absolute path, which the source does not have" in found.problems[0].message


def test_texts_are_told_from_numbers() -> None:
    found = returned(
        "LaunchDescription([Node(package='p', executable='e', parameters=[{'a': '1.0', 'b': 1.0, 'c': LaunchConfiguration('c'),"
        " 'd': ParameterValue(LaunchConfiguration('d'), value_type=str), 'e': os.environ.get('E', '1'), 'f': ['1', 2]}])])"
    )
    assert found.nodes[0].text_parameters == ("a", "d", "e")
    assert dict(found.nodes[0].parameters)["f"] == "['1', 2]"
    xml = '<launch><node pkg="p" exec="e"><param name="a" value="1.0" type="str"/><param name="b" value="1.0"/></node></launch>'
    assert launch(xml, "a.launch.xml").nodes[0].text_parameters == ("a",)
    text = "launch:\n- node: {pkg: p, exec: e, param: [{name: a, value: '1.0'}, {name: b, value: 1.0}]}\n"
    assert launch(text, "a.launch.yaml").nodes[0].text_parameters == ("a",)


@pytest.mark.parametrize("file", ["a.launch.py", "a.launch.xml", "a.launch.yaml"])
def test_a_container_in_a_namespace_holds_its_nodes(tmp_path: Path, file: str) -> None:
    text = {
        "a.launch.py": """
            def generate_launch_description():
                return LaunchDescription([
                    ComposableNodeContainer(name='box', namespace='cams', package='c', executable='c',
                        composable_node_descriptions=[ComposableNode(package='p', plugin='p::A', name='a')]),
                    LoadComposableNodes(target_container='box', composable_node_descriptions=[
                        ComposableNode(package='p', plugin='p::B', name='b')])])
        """,
        "a.launch.xml": """
            <launch><node_container pkg="c" exec="c" name="box" namespace="cams">
              <composable_node pkg="p" plugin="p::A" name="a"/></node_container>
              <load_composable_node target="box"><composable_node pkg="p" plugin="p::B" name="b"/></load_composable_node></launch>
        """,
        "a.launch.yaml": """
            launch:
            - node_container: {pkg: c, exec: c, name: box, namespace: cams, composable_node: [{pkg: p, plugin: 'p::A', name: a}]}
            - load_composable_node: {target: box, composable_node: [{pkg: p, plugin: 'p::B', name: b}]}
        """,
    }[file]
    nodes = followed(tmp_path, text, file=file).nodes
    assert [node.container for node in nodes] == ["", "/cams/box", "/cams/box"]


def test_values_that_a_launch_file_replaces_in_a_parameter_file_reach_the_node() -> None:
    found = returned(
        "LaunchDescription([Node(package='p', executable='e', parameters=[ParameterFile(RewrittenYaml("
        "source_file='c.yaml', root_key='', param_rewrites={'autostart': True}), allow_substs=True)])])"
    )
    assert found.nodes[0].parameter_files == ("c.yaml",)
    assert found.nodes[0].parameters == (("autostart", "true"),)


def test_a_text_of_the_environment_is_kept_in_the_cache(tmp_path: Path) -> None:
    text = """
import os
def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument('base', default_value=os.getenv('BASE')),
        IncludeLaunchDescription(PythonLaunchDescriptionSource(os.environ['FILE'])),
        Node(package=os.environ['P'], executable=os.getenv('E', 'e'), name=os.environ['N'], namespace=os.environ['S'],
             arguments=[os.environ['A']], remappings=[(os.environ['F'], os.environ['T'])], condition=IfCondition(os.environ['C']),
             parameters=[os.environ['Y'], {'rate': ParameterValue(os.environ['R'], value_type=str), os.environ['K']: os.environ['V']}],
             prefix=os.environ['X'], additional_env={os.environ['G']: os.environ['H']}),
    ])
"""
    package(tmp_path / "src", "up", {"launch/a.launch.py": text})
    first = generate_profile(tmp_path / "src", cache=tmp_path / "cache")
    assert generate_profile(tmp_path / "src", cache=tmp_path / "cache") == first
    assert len(first.packages[0].launches[0].nodes) == 1


def test_the_first_slip_of_an_xml_file_is_named(tmp_path: Path) -> None:
    found = followed(tmp_path, '<launch>\n<node pkg="p" exec="e"/>\n<node pkg="q" exec="f"', file="a.launch.xml")
    (problem,) = found.problems
    assert (problem.file, problem.line) == ("launch/a.launch.xml", 3)
    assert "is not well-formed XML and is read as far as it goes" in problem.message
    assert followed(tmp_path / "well", '<launch><node pkg="p" exec="e"/></launch>', file="a.launch.xml").problems == ()


def test_an_include_whose_name_is_not_in_the_source_has_a_next_step(tmp_path: Path) -> None:
    text = f"""
import os
def generate_launch_description():
    lidar = ThisLaunchFileDir() + str(find_lidar(os.environ['LIDAR']))
    return LaunchDescription([{NODE}, IncludeLaunchDescription(PythonLaunchDescriptionSource([lidar, '/lidar.launch.py']))])
"""
    (problem,) = followed(tmp_path, text).problems
    assert problem.message.endswith("import the file that it means, too, or give its nodes components of their own")
    assert "$(" not in problem.message
