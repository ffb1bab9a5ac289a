"""Examples of other ways to put ROS on Kubernetes: FogROS2, KubeROS, robolaunch and rapyuta.io."""

from tests.live.peer_examples.example import (
    X11,
    Example,
    Json,
    Verdict,
    config_map,
    env,
    has_container_fields,
    has_link,
    has_pod_fields,
    has_service,
    has_variables,
    make_app,
    mount,
    mounts,
    part,
    runs_on,
    share_a_domain,
)

FOGROS = "registry.example/fogros2:humble"
HELLO = "registry.example/hello-world:humble"
WORKSPACE = "registry.example/ros-build:foxy"
SEEN = [mount("workspace", "/home/workspaces"), mount("x11", X11)]
SHARED = {
    "shareProcessNamespace": True,
    "volumes": [
        {"name": "workspace", "persistentVolumeClaim": {"claimName": "robolaunch-workspace"}},
        {"name": "x11", "emptyDir": {}},
    ],
}
ON_ROBOT = {"nodeSelector": {"matchLabels": {"peer.example/fleet": "lab"}}}


def fogros_talker() -> Example:
    """A launch file that sends the talker to a cloud machine and keeps the listener on the robot."""
    program = {"package": "fogros2_examples"}
    return Example(
        "FogROS2: talker in the cloud",
        "BerkeleyAutomation/FogROS2",
        apps=[
            make_app(
                "fog-talker",
                "humble",
                part("talker", FOGROS, run={**program, "executable": "talker"}, runsOn=["Cloud"]),
                part("listener", FOGROS, run={**program, "executable": "listener"}, runsOn=["Robot"]),
                robots={**ON_ROBOT, "assignment": "Any"},
            )
        ],
        promises=[
            has_container_fields("talker", args=["ros2", "run", "fogros2_examples", "talker"]),
            runs_on("talker", "cloud"),
            runs_on("listener", "robot"),
            share_a_domain(("talker", ""), ("listener", "")),
        ],
    )


def fogros_segmentation() -> Example:
    """A client on the robot calls a service of a model that needs a GPU."""
    graphics = {"limits": {"nvidia.com/gpu": 1}}
    return Example(
        "FogROS2: segmentation on a GPU",
        "BerkeleyAutomation/fogros-realtime-examples",
        apps=[
            make_app(
                "fog-sam",
                "humble",
                part("client", FOGROS, run={"package": "sam", "executable": "sam_client"}, runsOn=["Robot"]),
                part(
                    "server",
                    FOGROS,
                    run={"package": "sam", "executable": "sam_service"},
                    runsOn=["Cloud"],
                    resources=graphics,
                ),
                robots={**ON_ROBOT, "assignment": "Any"},
            )
        ],
        promises=[
            has_container_fields("server", args=["ros2", "run", "sam", "sam_service"]),
            runs_on("server", "cloud"),
            has_container_fields(
                "server", resources={"limits": {"nvidia.com/gpu": "1"}, "requests": {"nvidia.com/gpu": "1"}}
            ),
        ],
    )


def kuberos_hello_world() -> Example:
    """Two modules with launch parameters, a parameter file at a path of its own, and an order of tiers."""
    folder = "/ws/config/minimal_publisher"
    start = (
        "source /ws/install/setup.bash && exec ros2 launch minimal_publisher_extended publisher.launch.py "
        f"init_topic:='Container World' params_file:={folder}/publisher-param.yaml"
    )
    listen = "source /ws/install/setup.bash && exec ros2 run examples_rclpy_minimal_subscriber subscriber_lambda"
    return Example(
        "KubeROS: hello world",
        "kuberos-io/ros2-basic-examples",
        apps=[
            make_app(
                "kuberos-hello",
                "humble",
                part(
                    "talker",
                    HELLO,
                    args=["bash", "-c", start],
                    runsOn=["Robot"],
                    volumeMounts=[mount("parameters", folder)],
                    template={"spec": {"volumes": [{"name": "parameters", "configMap": {"name": "hello-publisher"}}]}},
                ),
                part("listener", HELLO, args=["bash", "-c", listen], runsOn=["Edge", "Robot"]),
                robots={**ON_ROBOT, "assignment": "Any"},
                edges=[{"topic": "/topic", "from": "talker", "to": "listener", "latency": {"budget": "50ms"}}],
            )
        ],
        beside=[config_map("hello-publisher", **{"publisher-param.yaml": "/**: {ros__parameters: {rate: 2.0}}"})],
        promises=[
            mounts("talker", folder, {"configMap": {"name": "hello-publisher"}}),
            runs_on("talker", "robot"),
            runs_on("listener", "edge"),
            share_a_domain(("talker", ""), ("listener", "")),
        ],
    )


def kuberos_navigation() -> Example:
    """A simulated robot with a desktop in the browser, the navigation stack and a program that sends goals."""
    privileged = {"securityContext": {"privileged": True}}
    display = env(
        IGN_PARTITION="sim",
        STARTX11="true",
        NOVNC_ENABLE="true",
        WINDOW_MANAGER_ENABLE="true",
        SIZEW="1600",
        SIZEH="1200",
    )
    simulate = (
        "source /ws/install/setup.bash && exec /entrypoint.sh x2goglx2 ros2 launch tb4_bringup "
        "turtlebot4_ignition.launch.py world:=warehouse headless:=true publish_pose_from_ign:=true"
    )
    navigate = (
        "source /ws/install/setup.bash && exec ros2 launch nav2_bringup_extended nav2_bringup_extended.launch.py "
        "use_sim_time:=True autostart:=False localization_method:=rtabmap params_file:=/ws/params.yaml"
    )
    drive = (
        "source /ws/install/setup.bash && exec ros2 run nav_to_pose nav_to_pose --launch-navigation True "
        "--localization-mode rtabmap --goal '0,-0.5,0;-2,-0.5,0'"
    )
    screen = {
        "spec": {"type": "NodePort", "ports": [{"name": "novnc", "port": 8080}]},
        "links": [{"name": "desktop", "port": "novnc", "path": "/vnc.html"}],
    }
    image = "registry.example/navigation:humble"
    return Example(
        "KubeROS: navigation with a simulated robot",
        "kuberos-io/kuberos-nav-slam",
        apps=[
            make_app(
                "kuberos-nav",
                "humble",
                part(
                    "robot",
                    image,
                    command=["bash", "-c", simulate],
                    env=display,
                    runsOn=["Robot"],
                    service=screen,
                    **privileged,
                ),
                part("stack", image, args=["bash", "-c", navigate], runsOn=["Edge"], **privileged),
                part("controller", image, args=["bash", "-c", drive], runsOn=["Robot"], **privileged),
                robots={**ON_ROBOT, "assignment": "Any"},
                ros2={"rmw": "rmw_cyclonedds_cpp"},
            )
        ],
        promises=[
            has_container_fields("robot", securityContext={"privileged": True}, command=["bash", "-c", simulate]),
            has_variables("robot", NOVNC_ENABLE="true", RMW_IMPLEMENTATION="rmw_cyclonedds_cpp"),
            has_service("robot", "NodePort", (8080, "TCP")),
            has_link("robot", "desktop", "http", "/vnc.html"),
            runs_on("stack", "edge"),
            share_a_domain(("robot", ""), ("stack", ""), ("controller", "")),
        ],
    )


def kuberos_batch_job() -> Example:
    """A hundred repetitions of each of eighteen combinations of parameters, each with an end."""
    return Example("KubeROS: batch job", "kuberos-io/kuberos-nav-slam", verdict=Verdict.NO)


def _robolaunch_page(name: str, image: str, port: int, **fields: object) -> Json:
    """Returns a program with a page at a port of the node, which sees the workspace and the windows of the others."""
    shown = {
        "spec": {"type": "NodePort", "ports": [{"name": name, "port": port}]},
        "links": [{"name": name, "port": name}],
    }
    return part(
        name,
        image,
        volumeMounts=SEEN,
        template={"spec": SHARED},
        service=shown,
        colocateWith=["launch"],
        **fields,
    )


def robolaunch_robot() -> Example:
    """A robot with a workspace built from its repository, a desktop and an editor in the browser, and a bridge."""
    build = {"image": WORKSPACE, "command": ["bash", "-c"], "volumeMounts": [mount("workspace", "/home/workspaces")]}
    clone = "[ -d /home/workspaces/main/src/demo ] || git clone https://git.example/demo /home/workspaces/main/src/demo"
    steps = [
        {"name": "clone", "args": [clone], **build},
        {"name": "build", "args": ["cd /home/workspaces/main && colcon build"], **build},
    ]
    run = "source /home/workspaces/main/install/setup.bash && exec ros2 launch demo demo.launch.py"
    return Example(
        "robolaunch: robot with workspace, desktop and editor",
        "robolaunch/robot-operator",
        apps=[
            make_app(
                "robolaunch-robot",
                "foxy",
                part(
                    "launch",
                    WORKSPACE,
                    command=["bash", "-c", run],
                    volumeMounts=SEEN,
                    template={"spec": {**SHARED, "initContainers": steps}},
                ),
                _robolaunch_page("vdi", "registry.example/vdi:foxy", 8055, securityContext={"privileged": True}),
                _robolaunch_page("ide", "registry.example/ide:foxy", 9000),
                part(
                    "bridge",
                    "registry.example/rosbridge:foxy",
                    launch={"package": "rosbridge_server", "file": "rosbridge_websocket_launch.xml"},
                    service={"spec": {"ports": [{"name": "ws", "port": 9090}]}},
                ),
            )
        ],
        beside=[{"kind": "PersistentVolumeClaim", "metadata": {"name": "robolaunch-workspace"}}],
        promises=[
            has_container_fields("launch", "clone", args=[clone]),
            has_pod_fields("vdi", shareProcessNamespace=True),
            has_service("vdi", "NodePort", (8055, "TCP")),
            has_service("bridge", "ClusterIP", (9090, "TCP")),
            has_link("ide", "ide", "http"),
            share_a_domain(("launch", ""), ("launch", "build"), ("vdi", ""), ("ide", ""), ("bridge", "")),
        ],
        verdict=Verdict.REDUCED,
    )


def rapyuta_rosbag() -> Example:
    """A talker of ROS 1 whose topics are recorded in files that are uploaded when somebody asks for them."""
    record = "rosbag record --all --split --max-splits=5 --duration=1m --lz4 --output-prefix=/bags/testbag"
    return Example(
        "rapyuta.io: package with a rosbag job",
        "rapyuta-robotics/rapyuta-io-cli",
        apps=[
            make_app(
                "rapyuta-rosbag",
                "noetic",
                part("talker", "registry.example/talker:noetic", launch={"package": "talker", "file": "talker.launch"}),
                part(
                    "testbag",
                    "ros:noetic",
                    args=record.split(),
                    volumeMounts=[mount("bags", "/bags")],
                    template={
                        "spec": {"volumes": [{"name": "bags", "persistentVolumeClaim": {"claimName": "rapyuta-bags"}}]}
                    },
                ),
            )
        ],
        beside=[{"kind": "PersistentVolumeClaim", "metadata": {"name": "rapyuta-bags"}}],
        promises=[
            has_container_fields("talker", args=["roslaunch", "--wait", "talker", "talker.launch"]),
            has_container_fields("testbag", args=record.split()),
            mounts("testbag", "/bags", {"persistentVolumeClaim": {"claimName": "rapyuta-bags"}}),
        ],
        verdict=Verdict.REDUCED,
    )
