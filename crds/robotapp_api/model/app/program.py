"""The program of a component as ROS finds it: an executable of a package, or a launch file."""

from typing import Annotated, Final

from pydantic import Field, StringConstraints

from robotapp_api.model.base import Model
from robotapp_api.model.markers import Rule
from robotapp_api.model.patterns import ROBOT_REFERENCE

_FIRST: Final = r"([A-Za-z_]|\$\((ROBOTAPP_ROBOT|ROBOTAPP_INSTANCE)\))"
"""An ordinal is a digit, with which no ROS name begins."""
_TOKEN: Final = rf"{_FIRST}([A-Za-z0-9_]|{ROBOT_REFERENCE})*"
NODE_NAME_PATTERN: Final = rf"^{_TOKEN}$"
REMAP_PATTERN: Final = rf"^(~/|/)?{_TOKEN}(/{_TOKEN})*$"
ARGUMENT_PATTERN: Final = "^[A-Za-z_][A-Za-z0-9_./-]*$"
_TOPIC: Final = "^(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$"

PackageName = Annotated[str, StringConstraints(min_length=1, max_length=255, pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]
ExecutableName = Annotated[
    str, StringConstraints(min_length=1, max_length=255, pattern=r"^[A-Za-z0-9_.][A-Za-z0-9_.+-]*$")
]
NodeName = Annotated[str, StringConstraints(min_length=1, max_length=255, pattern=NODE_NAME_PATTERN)]
Namespace = Annotated[str, StringConstraints(min_length=1, max_length=255, pattern=rf"^(/|/?{_TOKEN}(/{_TOKEN})*)$")]
RemapTarget = Annotated[str, StringConstraints(min_length=1, max_length=255, pattern=REMAP_PATTERN)]
Word = Annotated[str, StringConstraints(max_length=4096)]
LaunchFile = Annotated[str, StringConstraints(min_length=1, max_length=512, pattern=r"^[^\s-]\S*$")]
ArgumentName = Annotated[str, StringConstraints(min_length=1, max_length=255, pattern=ARGUMENT_PATTERN)]


class Run(Model):
    """An executable of a ROS package: `ros2 run`, in ROS 1 `rosrun`, through the entry point of the image."""

    package: PackageName
    """ROS package, such as demo_nodes_cpp."""
    executable: ExecutableName
    """Executable of the package, such as talker."""
    name: NodeName | None = None
    """Name of the node in place of the program's own. $(ROBOTAPP_ROBOT) and $(ROBOTAPP_INSTANCE) stand for the names of robot and
    instance, here as ROS names: amr-07 becomes amr_07. With replicaIdentity: Ordinal, _$(ROBOTAPP_ORDINAL) is added unless name or
    namespace has the ordinal: detector becomes detector_0, detector_1 and so on."""
    namespace: Namespace | None = None
    """ROS namespace of the node, such as /front, or /$(ROBOTAPP_ROBOT) for the robot's name as a ROS name."""
    remaps: Annotated[
        dict[str, RemapTarget],
        Field(max_length=64),
        Rule(
            rule=f"self.all(name, size(name) <= 255 && name.matches('{_TOPIC}'))",
            message="a name to remap is no ROS name; write for example {scan: /front/scan}",
        ),
        Rule(
            rule="self.all(name, !name.startsWith('__'))",
            message="__node, __name and __ns are no topics; write run.name and run.namespace",
            reason="FieldValueForbidden",
        ),
    ] = Field(default_factory=dict)
    """Names of topics, services and actions in the program, and what they are instead, such as {scan: /front/scan}."""
    args: Annotated[tuple[Word, ...], Field(max_length=128)] = ()
    """Arguments of the program itself, before those that ROS reads."""


class Launch(Model):
    """A launch file: `ros2 launch`, in ROS 1 `roslaunch`, through the entry point of the image."""

    RULES = (
        Rule(
            rule="has(self.package) || self.file.startsWith('/')",
            message="without package, file is a path in the container; write package, or a path that begins with /",
            path=".file",
        ),
        Rule(
            rule="!has(self.parametersArgument) || !has(self.arguments) || !(self.parametersArgument in self.arguments)",
            message="parametersArgument is given the path of the parameter file; remove this argument from arguments",
            path=".arguments",
        ),
    )

    package: PackageName | None = None
    """ROS package that has the launch file; absent means that file is a path in the container."""
    file: LaunchFile
    """Name of the launch file in its package, or its path in the container."""
    arguments: Annotated[
        dict[str, Annotated[str, StringConstraints(max_length=1024)]],
        Field(max_length=64),
        Rule(
            rule=f"self.all(name, size(name) <= 255 && name.matches('{ARGUMENT_PATTERN}'))",
            message="a name of a launch argument has letters, digits, '_', '.', '-' and '/' only; write for example {use_sim_time: \"true\"}",
        ),
    ] = Field(default_factory=dict)
    """Values of launch arguments. $(ROBOTAPP_ROBOT) and $(ROBOTAPP_INSTANCE) stand for the names of robot and instance as they are,
    $(ROBOTAPP_ORDINAL) for the ordinal of a replica."""
    parameters_argument: ArgumentName | None = None
    """Launch argument that is given the path of the component's parameter file, such as params_file. Left out while an optional
    file is absent."""
