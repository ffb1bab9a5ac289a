"""The four-legged robot of gorizond/spot, whose authors run it as DaemonSets that reach into the machine."""

from tests.live.peer_examples.example import (
    Example,
    Json,
    config_map,
    env,
    has_container_fields,
    has_no_ros,
    has_pod_fields,
    has_pods,
    host_path,
    make_app,
    mount,
    mounts,
    part,
    share_a_domain,
    shell,
)

IMAGE = "registry.example/spot:kilted"
ROOT = {"privileged": True, "runAsUser": 0, "runAsGroup": 0, "allowPrivilegeEscalation": True}
LIMITS = {"requests": {"cpu": "50m", "memory": "96Mi"}, "limits": {"cpu": "200m", "memory": "192Mi"}}
NODE_NAME = {"name": "NODE_NAME", "valueFrom": {"fieldRef": {"fieldPath": "spec.nodeName"}}}
ARM = {"nodeSelector": {"kubernetes.io/arch": "arm64"}}
FILES = {"name": "spot-files", "defaultMode": 0o555, "items": [{"key": "gait.yaml", "path": "champ/gait.yaml"}]}


def _start(package: str) -> Json:
    script = f"source /opt/ros/kilted/setup.bash; exec ros2 run {package} {package}_node"
    return {"command": ["bash", "-lc"], "args": [script]}


def _servos() -> Json:
    """Returns the pod with three programs, of which one drives the servos over I2C and one reads labels of its node."""
    driver = {
        "name": "servo-driver",
        "image": IMAGE,
        "imagePullPolicy": "Always",
        "securityContext": ROOT,
        "env": env(SERVO_MAP_TOPIC="/spot/config/servo_map", PWM_HZ="50"),
        "volumeMounts": [mount("i2c-1", "/dev/i2c-1")],
        **_start("spot_servo_driver_cpp"),
    }
    mux = {
        "name": "cmd-mux",
        "image": IMAGE,
        "env": env(DEFAULT_MODE="auto"),
        "resources": LIMITS,
        **_start("spot_cmd_mux_cpp"),
    }
    pod = {
        **ARM,
        "serviceAccountName": "spot-labels",
        "containers": [driver, mux],
        "volumes": [host_path("i2c-1", "/dev/i2c-1", "CharDevice")],
    }
    return part(
        "node-label-config",
        IMAGE,
        imagePullPolicy="Always",
        env=[NODE_NAME, *env(LABEL_PREFIX="peer.example/pca9685-", TOPIC="/spot/config/servo_map")],
        resources=LIMITS,
        template={"spec": pod},
        **_start("spot_node_label_config_cpp"),
    )


def _others() -> list[Json]:
    """Returns the controller, the program that switches the bus on in the machine's boot files, and the distance sensors."""
    bootstrap = {**ARM, "hostPID": True, "volumes": [host_path("boot", "/boot"), host_path("dev", "/dev")]}
    chip = host_path("gpiochip0", "/dev/gpiochip0", "CharDevice")
    switch_on = "test -c /host-dev/i2c-1 || echo dtparam=i2c_arm=on >> /host-boot/config.txt; sleep infinity"
    return [
        part(
            "champ",
            IMAGE,
            volumeMounts=[mount("files", "/opt/spot", readOnly=True)],
            template={"spec": {**ARM, "volumes": [{"name": "files", "configMap": FILES}]}},
            **_start("champ_bringup"),
        ),
        part(
            "bootstrap",
            "ubuntu:24.04",
            ros="None",
            securityContext=ROOT,
            env=[NODE_NAME],
            volumeMounts=[mount("boot", "/host-boot"), mount("dev", "/host-dev")],
            template={"spec": bootstrap},
            **shell(switch_on),
        ),
        part(
            "hcsr04",
            IMAGE,
            securityContext=ROOT,
            env=env(SENSORS="front_left:5:12,front_right:6:13"),
            volumeMounts=[mount("gpiochip0", "/dev/gpiochip0")],
            template={"spec": {**ARM, "hostPID": True, "hostNetwork": True, "volumes": [chip]}},
        ),
    ]


def spot() -> Example:
    """One app in place of four DaemonSets: it runs on every robot whose node has the label of the bus."""
    chosen = {
        "matchLabels": {"peer.example/fleet": "lab"},
        "matchExpressions": [{"key": "peer.example/i2c-bus", "operator": "Exists"}],
    }
    servos = "node-label-config"
    bus = {"hostPath": {"path": "/dev/i2c-1", "type": "CharDevice"}}
    return Example(
        "Spot: a robot as DaemonSets",
        "gorizond/spot",
        apps=[
            make_app(
                "spot",
                "kilted",
                _servos(),
                *_others(),
                robots={"nodeSelector": chosen},
                ros2={"rmw": "rmw_cyclonedds_cpp"},
            )
        ],
        beside=[
            {"kind": "ServiceAccount", "metadata": {"name": "spot-labels"}},
            config_map("spot-files", **{"gait.yaml": "gait: {}"}),
        ],
        promises=[
            has_pods(servos, 2),
            has_pods("hcsr04", 2),
            has_pod_fields("hcsr04", hostNetwork=True, hostPID=True),
            has_pod_fields("bootstrap", hostPID=True),
            has_no_ros("bootstrap"),
            has_pod_fields(servos, serviceAccountName="spot-labels"),
            has_container_fields(servos, "servo-driver", securityContext=ROOT, imagePullPolicy="Always"),
            mounts(servos, "/dev/i2c-1", bus, "servo-driver"),
            mounts("champ", "/opt/spot", {"configMap": FILES}),
            share_a_domain((servos, ""), (servos, "servo-driver"), (servos, "cmd-mux"), ("champ", "")),
        ],
    )
