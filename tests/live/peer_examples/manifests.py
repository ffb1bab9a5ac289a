"""Examples that their authors wrote as plain Deployments and Services: RobotKube, Canonical, Autoware and RTI."""

from tests.live.peer_examples.example import (
    SHARED_MEMORY,
    X11,
    Example,
    Json,
    Promise,
    config_map,
    env,
    has_container_fields,
    has_no_ros,
    has_pod_fields,
    has_pods,
    has_service,
    has_variables,
    host_path,
    is_chosen_by,
    make_app,
    mount,
    mounts,
    part,
    runs_on,
    service,
    share_a_domain,
    shell,
)

CONNEXT = "registry.example/connext:7"
LAB = {"nodeSelector": {"matchLabels": {"peer.example/fleet": "lab"}}}


def _volume_of(name: str, **source: object) -> Json:
    return {"name": name, **source}


def _settings(name: str) -> Json:
    return _volume_of("settings", configMap={"name": name})


def _claimed(name: str) -> Json:
    return _volume_of(name, persistentVolumeClaim={"claimName": name})


BRIDGE = "/docker-ros/ws/install/share/mqtt_client/params"
WAIT = "source install/setup.bash; until ros2 topic list; do sleep 0.1; done; exec ros2 launch "
MANAGER = shell(f"{WAIT}application_manager application_manager.launch.py")
AT_ONCE = {"terminationGracePeriodSeconds": 0}
KUBE = "registry.example/robotkube"


def _robotkube_cloud() -> Json:
    detector = shell(f"{WAIT}event_detector_operator_plugin event_detector_operator_plugin.launch.py startup_state:=3")
    operator_pod = {
        **AT_ONCE,
        "volumes": [_settings("robotkube-detector")],
        "containers": [{"name": "application-manager", "image": f"{KUBE}:manager", **MANAGER}],
    }
    database = {
        "metadata": {"labels": {"app": "cloud-database"}},
        "spec": {"volumes": [_claimed("robotkube-mongodb")]},
    }
    plain = {"ros": "None", "runsOn": ["Cloud"]}
    return make_app(
        "robotkube-cloud",
        "humble",
        part(
            "operator",
            f"{KUBE}:detector",
            runsOn=["Cloud"],
            volumeMounts=[mount("settings", "/docker-ros/config")],
            template={"spec": operator_pod},
            **detector,
        ),
        part(
            "database",
            "mongo:6",
            ports=[{"containerPort": 27017}],
            volumeMounts=[mount("robotkube-mongodb", "/data/db")],
            template=database,
            **plain,
        ),
        part(
            "broker",
            "eclipse-mosquitto:2",
            command=["mosquitto"],
            args=["-c", "/mosquitto-no-auth.conf"],
            template={"metadata": {"labels": {"app": "cloud-broker"}}},
            **plain,
        ),
    )


def _robotkube_vehicles() -> Json:
    client = shell(f"{WAIT}{BRIDGE}/client.launch.xml params_file:={BRIDGE}/mqtt_params_$(ROBOTAPP_ROBOT).yaml")
    return make_app(
        "robotkube-vehicles",
        "humble",
        part(
            "mqtt",
            f"{KUBE}:mqtt",
            env=env(VEHICLE="$(ROBOTAPP_ROBOT)"),
            runsOn=["Robot"],
            volumeMounts=[mount("settings", BRIDGE)],
            template={"spec": {**AT_ONCE, "volumes": [_settings("robotkube-mqtt")]}},
            **client,
        ),
        part("publisher", f"{KUBE}:bags", runsOn=["Robot"], template={"spec": AT_ONCE}, **shell("sleep infinity")),
        robots=LAB,
    )


def robotkube() -> Example:
    """A cloud with two programs in one pod, a database and a broker; a client and a player of records on every vehicle."""
    return Example(
        "RobotKube: cloud and vehicles",
        "ika-rwth-aachen/robotkube",
        apps=[_robotkube_cloud(), _robotkube_vehicles()],
        beside=[
            config_map("robotkube-detector", params="startup_state: 3"),
            config_map("robotkube-mqtt", params="broker: {host: service-mqtt-broker-mosquitto}"),
            {"kind": "PersistentVolumeClaim", "metadata": {"name": "robotkube-mongodb"}},
            service("mongodb", {"app": "cloud-database"}, 27017),
            service("service-mqtt-broker-mosquitto", {"app": "cloud-broker"}, 1883),
        ],
        promises=[
            has_container_fields("operator", "application-manager", **MANAGER),
            share_a_domain(("operator", ""), ("operator", "application-manager")),
            has_no_ros("database"),
            is_chosen_by("mongodb", "database"),
            is_chosen_by("service-mqtt-broker-mosquitto", "broker"),
            mounts("database", "/data/db", {"persistentVolumeClaim": {"claimName": "robotkube-mongodb"}}),
            has_pods("mqtt", 2),
            has_pod_fields("mqtt", terminationGracePeriodSeconds=0),
            runs_on("operator", "cloud"),
        ],
    )


def robotkube_ros1() -> Example:
    """The same cloud for ROS 1: a master, and programs that other nodes reach by the name of a Service of their own."""
    wait = "source install/setup.bash; until rostopic list; do sleep 0.1; done; exec "
    root = env(DOCKER_USER="root")
    folder = "/docker-ros/ws/install/share"

    def program(name: str, script: str, **fields: object) -> Json:
        labels = {"node": f"robotkube-{name}"}
        template = {"metadata": {"labels": labels}, "spec": {"terminationGracePeriodSeconds": 0}}
        template["spec"].update(fields.pop("pod", {}))
        variables = [*root, *env(ROS_HOSTNAME=f"service-robotkube-{name}"), *fields.pop("variables", ())]
        return part(
            name, f"registry.example/robotkube-ros1:{name}", env=variables, template=template, **shell(script), **fields
        )

    client = f"{wait}roslaunch {folder}/mqtt_client/params/standalone_mqtt_client.launch"
    return Example(
        "RobotKube: cloud with ROS 1",
        "ika-rwth-aachen/robotkube",
        apps=[
            make_app(
                "robotkube-ros1",
                "noetic",
                program(
                    "detector",
                    f"{wait}roslaunch {folder}/event_detector/launch/standalone_ed_k8s.launch",
                    volumeMounts=[mount("settings", f"{folder}/event_detector/launch")],
                    pod={"volumes": [_settings("robotkube-ed-params")]},
                ),
                program("manager", f"{wait}rosrun application_manager application_manager.py"),
                program("mqtt", client, variables=env(VEHICLE="vehicle_00")),
            )
        ],
        beside=[
            config_map("robotkube-ed-params", **{"standalone_ed_k8s.launch": "<launch/>"}),
            service("service-robotkube-detector", {"node": "robotkube-detector"}, 11311, clusterIP="None"),
            service("service-robotkube-manager", {"node": "robotkube-manager"}, 11311, clusterIP="None"),
            service("service-robotkube-mqtt", {"node": "robotkube-mqtt"}, 11311, clusterIP="None"),
        ],
        promises=[
            has_variables("detector", DOCKER_USER="root", ROS_HOSTNAME="service-robotkube-detector"),
            is_chosen_by("service-robotkube-mqtt", "mqtt"),
            mounts("detector", f"{folder}/event_detector/launch", {"configMap": {"name": "robotkube-ed-params"}}),
            Promise(
                "all: one master",
                lambda running: len(
                    {
                        item["value"]
                        for name in ("detector", "manager", "mqtt")
                        for item in running.container(name)["env"]
                        if item["name"] == "ROS_MASTER_URI"
                    }
                ),
                1,
            ),
        ],
    )


def canonical_talkers() -> Example:
    """Two talkers and a listener that find each other by multicast on a second network of the pods."""
    annotation = {"k8s.v1.cni.cncf.io/networks": "ros-multicast"}
    source = "source /opt/ros/foxy/setup.bash && exec ros2 run demo_nodes_cpp "

    def node(name: str, program: str, **fields: object) -> Json:
        return part(
            name, "ros:foxy", template={"metadata": {"annotations": annotation}}, **shell(source + program), **fields
        )

    return Example(
        "Canonical: two talkers and a listener",
        "ubuntu.com/blog/exploring-ros-2-kubernetes-configurations",
        apps=[
            make_app(
                "canonical",
                "foxy",
                node("talker", "talker", replicas=2),
                node("listener", "listener"),
                ros2={"discovery": {"mode": "Multicast"}},
            )
        ],
        promises=[
            Promise(
                "talker: two pods with the annotation of the second network",
                lambda running: [
                    pod["metadata"]["annotations"]["k8s.v1.cni.cncf.io/networks"] for pod in running.pods_of("talker")
                ],
                ["ros-multicast", "ros-multicast"],
            ),
            has_container_fields("talker", **shell(f"{source}talker")),
            share_a_domain(("talker", ""), ("listener", "")),
        ],
    )


def autoware() -> Example:
    """Seven parts of Autoware in the network of one machine, with two volumes and a window served by VNC."""
    data = {"ROS_HOME": "/autoware_data/.ros", "ROS_LOG_DIR": "/autoware_data/.ros/log"}
    user = {"runAsUser": 1000, "runAsGroup": 986}
    names = ("api", "control", "map", "planning", "simulator", "system", "vehicle")

    def module(name: str) -> Json:
        shown = name == "simulator"
        screen = [host_path("x11", X11)] if shown else []
        volumes = [_claimed("autoware-map"), _claimed("autoware-data"), *screen]
        script = f"source /opt/autoware/setup.bash\nexec ros2 launch tier4_{name}_launch {name}.launch.xml"
        return part(
            name,
            "registry.example/autoware:universe",
            imagePullPolicy="IfNotPresent",
            env=env(**data, **({"QT_QPA_PLATFORM": "vnc"} if shown else {})),
            ports=[{"name": "vnc", "containerPort": 5900, "hostPort": 5900, "protocol": "TCP"}] if shown else [],
            volumeMounts=[
                mount("autoware-map", "/autoware_map", readOnly=True),
                mount("autoware-data", "/autoware_data"),
                *([mount("x11", X11)] if shown else []),
            ],
            template={"spec": {"hostNetwork": True, "securityContext": user, "volumes": volumes}},
            **shell(script),
        )

    return Example(
        "Autoware on Kubernetes",
        "SabeshSudharsan/autoware-k8s-deployments",
        apps=[make_app("autoware", "humble", *map(module, names), ros2={"rmw": "rmw_fastrtps_cpp"})],
        beside=[
            {"kind": "PersistentVolumeClaim", "metadata": {"name": "autoware-map"}},
            {"kind": "PersistentVolumeClaim", "metadata": {"name": "autoware-data"}},
        ],
        promises=[
            has_pod_fields("control", hostNetwork=True),
            Promise(
                "simulator: port 5900 of the node",
                lambda running: [port["hostPort"] for port in running.container("simulator")["ports"]],
                [5900],
            ),
            Promise(
                "map: user and group",
                lambda running: (
                    {**running.pods_of("map")[0]["spec"]["securityContext"], **user}
                    == running.pods_of("map")[0]["spec"]["securityContext"]
                ),
            ),
            mounts("simulator", X11, {"hostPath": {"path": X11}}),
            mounts("api", "/autoware_data", {"persistentVolumeClaim": {"claimName": "autoware-data"}}),
            has_variables("simulator", QT_QPA_PLATFORM="vnc", RMW_IMPLEMENTATION="rmw_fastrtps_cpp", **data),
            share_a_domain(*((name, "") for name in names)),
        ],
    )


def connext_shared_memory() -> Example:
    """Two containers of a pod that exchange samples by shared memory, a discovery service and a subscriber elsewhere."""
    peers = "rtps@udpv4://rti-clouddiscoveryservice:7400"
    common = ["-domainId", "10", "-verbosity", "2", "-transport"]
    license_file = {"volumes": [_volume_of("license", configMap={"name": "rti-license"})]}
    beside_it = {
        "name": "subscriber",
        "image": CONNEXT,
        "args": ["-subscriber", *common, "2"],
        "env": env(NDDS_DISCOVERY_PEERS="shmem://"),
    }
    return Example(
        "RTI Connext: shared memory in a pod",
        "rticommunity/kubernetes-examples",
        apps=[
            make_app(
                "rti-shmem",
                "none",
                part(
                    "discovery-service",
                    CONNEXT,
                    ports=[{"containerPort": 7400, "protocol": "UDP"}],
                    volumeMounts=[mount("license", "/opt/rti/rti_license.dat", subPath="rti_license.dat")],
                    template={"metadata": {"labels": {"run": "rti-clouddiscoveryservice"}}, "spec": license_file},
                ),
                part(
                    "publisher",
                    CONNEXT,
                    args=["-publisher", *common, "3"],
                    env=env(NDDS_DISCOVERY_PEERS=f"shmem://,{peers}"),
                    sharedMemory={"size": "256Mi"},
                    template={"spec": {"shareProcessNamespace": True, "containers": [beside_it]}},
                ),
                part("elsewhere", CONNEXT, args=["-subscriber", *common, "1"], env=env(NDDS_DISCOVERY_PEERS=peers)),
            )
        ],
        beside=[
            config_map("rti-license", **{"rti_license.dat": "none"}),
            service(
                "rti-clouddiscoveryservice",
                {"run": "rti-clouddiscoveryservice"},
                7400,
                ports=[{"port": 7400, "protocol": "UDP"}],
            ),
        ],
        promises=[
            has_pod_fields("publisher", shareProcessNamespace=True),
            has_container_fields("publisher", "subscriber", args=beside_it["args"]),
            has_variables("publisher", NDDS_DISCOVERY_PEERS=f"shmem://,{peers}"),
            has_variables("publisher", "subscriber", NDDS_DISCOVERY_PEERS="shmem://"),
            mounts("publisher", SHARED_MEMORY, {"emptyDir": {"medium": "Memory", "sizeLimit": "256Mi"}}, "subscriber"),
            mounts("publisher", SHARED_MEMORY, {"emptyDir": {"medium": "Memory", "sizeLimit": "256Mi"}}),
            is_chosen_by("rti-clouddiscoveryservice", "discovery-service"),
            has_no_ros("publisher"),
        ],
    )


def connext_gateway() -> Example:
    """A routing service that applications outside of the cluster reach at a fixed port of every node."""
    settings = [
        _volume_of("config", configMap={"name": "rti-routing"}),
        _volume_of("license", configMap={"name": "rti-gateway-license"}),
    ]
    address = env(PUBLIC_IP="203.0.113.10", PUBLIC_PORT="30395", HOST_PORT="7400", WAN_DOMAIN="100", LAN_DOMAIN="10")
    outside = {
        "type": "NodePort",
        "ports": [{"name": "rwt", "port": 7400, "protocol": "UDP", "nodePort": 30395}],
    }
    peers = env(NDDS_DISCOVERY_PEERS="rtps@udpv4://rti-gateway-discovery:7400")
    return Example(
        "RTI Connext: gateway to the outside",
        "rticommunity/kubernetes-examples",
        apps=[
            make_app(
                "rti-gateway",
                "none",
                part(
                    "discovery-service",
                    CONNEXT,
                    ports=[{"containerPort": 7400, "protocol": "UDP"}],
                    template={"metadata": {"labels": {"run": "rti-gateway-discovery"}}},
                ),
                part("subscriber", CONNEXT, args=["-subscriber", "-domainId", "10"], env=peers),
                part(
                    "routing",
                    CONNEXT,
                    imagePullPolicy="Always",
                    args=["-cfgName", "RS-RWT", "-verbosity", "REMOTE:REMOTE"],
                    env=address,
                    ports=[{"containerPort": 7400, "protocol": "UDP"}],
                    volumeMounts=[mount("config", "/rti/USER_ROUTING_SERVICE.xml", subPath="USER_ROUTING_SERVICE.xml")],
                    template={"spec": {"volumes": settings}},
                    service={"spec": outside},
                ),
            )
        ],
        beside=[
            config_map("rti-routing", **{"USER_ROUTING_SERVICE.xml": "<dds/>"}),
            config_map("rti-gateway-license", **{"rti_license.dat": "none"}),
            service(
                "rti-gateway-discovery",
                {"run": "rti-gateway-discovery"},
                7400,
                ports=[{"port": 7400, "protocol": "UDP"}],
            ),
        ],
        promises=[
            has_service("routing", "NodePort", (7400, "UDP")),
            Promise(
                "routing: port", lambda running: running.service_of("routing")["spec"]["ports"][0]["nodePort"], 30395
            ),
            has_variables("routing", PUBLIC_IP="203.0.113.10", PUBLIC_PORT="30395"),
            has_container_fields("routing", imagePullPolicy="Always"),
            is_chosen_by("rti-gateway-discovery", "discovery-service"),
        ],
    )
