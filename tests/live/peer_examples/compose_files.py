"""Examples that their authors start with Docker compose: Husarion, Open AD Kit and TurtleBot3."""

from tests.live.peer_examples.example import (
    X11,
    Example,
    Json,
    config_map,
    env,
    has_container_fields,
    has_link,
    has_pod_fields,
    has_pods,
    has_service,
    has_variables,
    host_path,
    make_app,
    mount,
    mounts,
    part,
    runs_on,
    share_a_domain,
)

HOST = {"hostNetwork": True, "hostIPC": True}
LAB = {"nodeSelector": {"matchLabels": {"peer.example/fleet": "lab"}}}
SCREEN = host_path("x11", X11, "Directory")


def _pod(*volumes: Json, **fields: object) -> Json:
    return {"spec": {**HOST, **fields, **({"volumes": list(volumes)} if volumes else {})}}


PROFILE = env(FASTRTPS_DEFAULT_PROFILES_FILE="/shm-only.xml", USER="root", ROBOT_NAMESPACE="rosbot2r")


def _husarion_driver(name: str, device: str, path: str, **launch: object) -> Json:
    """Returns a driver of a serial port of the robot, which the container sees at `path`."""
    return part(
        name,
        f"husarion/{name}:humble",
        runsOn=["Robot"],
        launch=launch,
        env=PROFILE,
        securityContext={"privileged": True},
        volumeMounts=[mount("serial", path)],
        template=_pod(host_path("serial", device, "CharDevice")),
        readinessProbe={"exec": {"command": ["/healthcheck.sh"]}},
    )


def _husarion_others() -> list[Json]:
    """Returns the router to other networks, and navigation."""
    config = {"name": "config", "configMap": {"name": "husarion-navigation"}}
    arguments = {"slam": "True", "params_file": "/params.yaml", "map": "/maps/map.yaml", "use_sim_time": "False"}
    return [
        part(
            "ros2router",
            "husarnet/ros2router:1.6.3",
            runsOn=["Robot"],
            env=env(USER="root", ROBOT_NAMESPACE="rosbot2r", DISCOVERY_SERVER_LISTENING_PORT="11811"),
            volumeMounts=[mount("config", "/filter.yaml", subPath="filter.yaml")],
            template=_pod(config),
        ),
        part(
            "navigation",
            "husarion/navigation2:humble",
            runsOn=["Robot"],
            launch={"file": "/husarion_utils/bringup_launch.py", "arguments": arguments},
            env=[*PROFILE, *env(SAVE_MAP_PERIOD="15")],
            volumeMounts=[mount("config", "/params.yaml", subPath="params.yaml"), mount("maps", "/maps")],
            template=_pod(config, host_path("maps", "/srv/rosbot/maps")),
            dependsOn=[{"component": "rplidar"}, {"component": "rosbot"}],
        ),
    ]


def husarion_autonomy() -> Example:
    """A robot's base and lidar at serial ports, navigation that waits for both, and a router to other networks."""
    base = {"mecanum": "False", "serial_port": "/dev/ttyUSB_base", "serial_baudrate": "576000"}
    lidar = {"serial_baudrate": "256000", "serial_port": "/dev/ttyUSB0"}
    drivers = [
        _husarion_driver(
            *("rosbot", "/dev/ttyUSB_base", "/dev/ttyUSB_base"),
            package="rosbot_bringup",
            file="combined.launch.py",
            arguments=base,
        ),
        _husarion_driver(
            *("rplidar", "/dev/ttyRPLIDAR", "/dev/ttyUSB0"), file="/husarion_utils/rplidar.launch.py", arguments=lidar
        ),
    ]
    multicast = {"discovery": {"mode": "Multicast"}}
    words = "ros2 launch /husarion_utils/rplidar.launch.py serial_baudrate:=256000 serial_port:=/dev/ttyUSB0"
    return Example(
        "Husarion: rosbot autonomy",
        "husarion/rosbot-autonomy",
        apps=[make_app("husarion", "humble", *drivers, *_husarion_others(), robots=LAB, ros2=multicast)],
        beside=[config_map("husarion-navigation", **{"params.yaml": "amcl: {}", "filter.yaml": "allowlist: []"})],
        promises=[
            has_pod_fields("rosbot", **HOST),
            has_pods("navigation", 2),
            has_container_fields("rplidar", securityContext={"privileged": True}, args=words.split()),
            mounts("rplidar", "/dev/ttyUSB0", {"hostPath": {"path": "/dev/ttyRPLIDAR", "type": "CharDevice"}}),
            mounts("navigation", "/maps", {"hostPath": {"path": "/srv/rosbot/maps"}}),
            has_variables("rosbot", FASTRTPS_DEFAULT_PROFILES_FILE="/shm-only.xml"),
            share_a_domain(("rosbot", ""), ("rplidar", "")),
        ],
    )


WAITS = {
    "map": [],
    "planning": ["map"],
    "vehicle": ["map"],
    "system": ["map"],
    "control": ["map", "planning", "system"],
    "simulator": ["map", "system", "vehicle"],
    "api": ["map"],
}
"""What starts before each part of Autoware."""


def open_ad_kit() -> Example:
    """Autoware's planning simulation: eight services that share network, memory and processes of one machine."""
    options = {
        "map": {"map_path": "/autoware_map", "lanelet2_map_file": "lanelet2_map.osm"},
        "simulator": {"perception/enable_traffic_light": "true", "sensing/visible_range": "300.0"},
    }
    parts = [
        part(
            name,
            f"registry.example/openadkit:{name}",
            launch={
                "package": "autoware_launch",
                "file": f"tier4_{name}_component.launch.xml",
                "arguments": {"use_sim_time": "false", "vehicle_model": "sample_vehicle", **options.get(name, {})},
            },
            dependsOn=[{"component": other} for other in WAITS[name]],
            colocateWith=[] if name == "map" else ["map"],
            template=_pod(*([host_path("maps", "/srv/autoware/map")] if name == "map" else []), hostPID=True),
            volumeMounts=[mount("maps", "/autoware_map", readOnly=True)] if name == "map" else [],
        )
        for name in WAITS
    ]
    visualizer = part(
        "visualizer",
        "registry.example/openadkit:visualizer",
        env=env(RVIZ_CONFIG="/autoware/rviz/autoware.rviz", USE_SIM_TIME="false"),
        ports=[{"containerPort": 6080}],
        template=_pod(hostPID=True),
        service={
            "spec": {"type": "NodePort", "ports": [{"name": "web", "port": 6080}]},
            "links": [{"name": "rviz", "port": "web", "path": "/vnc.html"}],
        },
        colocateWith=["map"],
    )
    everything = [(name, "") for name in (*WAITS, "visualizer")]
    return Example(
        "Open AD Kit: planning simulation",
        "autowarefoundation/openadkit",
        apps=[make_app("open-ad-kit", "humble", *parts, visualizer, ros2={"rmw": "rmw_cyclonedds_cpp"})],
        promises=[
            has_pod_fields("control", **HOST, hostPID=True),
            mounts("map", "/autoware_map", {"hostPath": {"path": "/srv/autoware/map"}}),
            has_container_fields(
                "simulator",
                args=[
                    *("ros2", "launch", "autoware_launch", "tier4_simulator_component.launch.xml"),
                    *("perception/enable_traffic_light:=true", "sensing/visible_range:=300.0"),
                    *("use_sim_time:=false", "vehicle_model:=sample_vehicle"),
                ],
            ),
            has_variables("visualizer", RVIZ_CONFIG="/autoware/rviz/autoware.rviz"),
            has_service("visualizer", "NodePort", (6080, "TCP")),
            has_link("visualizer", "rviz", "http", "/vnc.html"),
            share_a_domain(*everything),
        ],
    )


def turtlebot_behaviors() -> Example:
    """A simulated world and a behaviour tree, with windows on the screen of the machine and its graphics card."""
    screen = env(TURTLEBOT_MODEL="3", DISPLAY=":0", QT_X11_NO_MITSHM="1", NVIDIA_DRIVER_CAPABILITIES="all")
    common = {
        "env": screen,
        "stdin": True,
        "tty": True,
        "securityContext": {"privileged": True},
        "resources": {"limits": {"nvidia.com/gpu": 1}},
        "volumeMounts": [mount("x11", X11), mount("authority", "/root/.Xauthority")],
        "template": _pod(SCREEN, host_path("authority", "/home/user/.Xauthority", "File")),
    }
    tree = {"tree_type": "queue", "enable_vision": "true", "target_color": "blue"}
    image = "registry.example/turtlebot-behavior:overlay"
    return Example(
        "TurtleBot3: behaviours",
        "sea-bass/turtlebot3_behavior_demos",
        apps=[
            make_app(
                "turtlebot",
                "jazzy",
                part("world", image, launch={"package": "tb_worlds", "file": "tb_demo_world.launch.py"}, **common),
                part(
                    "behavior",
                    image,
                    launch={"package": "tb_autonomy", "file": "tb_demo_behavior_py.launch.py", "arguments": tree},
                    colocateWith=["world"],
                    **common,
                ),
            )
        ],
        promises=[
            has_pod_fields("world", **HOST),
            has_container_fields("behavior", stdin=True, tty=True, securityContext={"privileged": True}),
            mounts("world", X11, {"hostPath": {"path": X11, "type": "Directory"}}),
            mounts("world", "/root/.Xauthority", {"hostPath": {"path": "/home/user/.Xauthority", "type": "File"}}),
            has_variables("world", DISPLAY=":0", TURTLEBOT_MODEL="3"),
            runs_on("world", "cloud", "edge", "robot"),
            share_a_domain(("world", ""), ("behavior", "")),
        ],
    )
