"""The deployment template of Open-RMF: traffic of a fleet in the cloud, a site in the network of its machine, and a web page."""

from tests.live.peer_examples.example import (
    Example,
    Json,
    config_map,
    env,
    has_container_fields,
    has_no_ros,
    has_pod_fields,
    has_variables,
    is_chosen_by,
    make_app,
    mount,
    mounts,
    part,
    service,
    share_a_domain,
    shell,
)

RMF = "registry.example/rmf"
TOLERATES = [{"key": "reserved", "operator": "Equal", "value": "rmf", "effect": "NoSchedule"}]
DDS = env(RMF_USE_SIM_TIME="true", CYCLONEDDS_URI="/etc/cyclonedds/cyclonedds.xml")
DDS_FILE = {"name": "cyclonedds", "configMap": {"name": "cyclonedds-configmap"}}
KEY_FILE = {"name": "key", "configMap": {"name": "jwt-pub-key"}}
SERVER = "ws://rmf-web-rmf-server:8000/_internal"


def _core(name: str, command: str, *, pod: Json | None = None, **fields: object) -> Json:
    """Returns a module of ROS as all of them are written: a shell, a file of Cyclone DDS, a toleration."""
    labels = {"app": f"rmf-{name}"}
    more = pod or {}
    spec = {"tolerations": TOLERATES, **more, "volumes": [DDS_FILE, *more.get("volumes", ())]}
    mounted = [mount("cyclonedds", "/etc/cyclonedds"), *fields.pop("volumeMounts", ())]
    variables = [*DDS, *fields.pop("env", ())]
    template = {"metadata": {"labels": labels}, "spec": spec}
    return part(
        name,
        f"{RMF}/rmf",
        env=variables,
        volumeMounts=mounted,
        template=template,
        **shell(f"/ros_entrypoint.sh {command}"),
        **fields,
    )


def _secret(name: str, key: str) -> Json:
    return {"name": name, "valueFrom": {"secretKeyRef": {"name": "keycloak-secret", "key": key}}}


def _web(name: str, image: str, port: int, *volumes: Json, **fields: object) -> Json:
    """Returns a program without ROS behind a Service of the authors."""
    spec = {"tolerations": TOLERATES, **({"volumes": list(volumes)} if volumes else {})}
    template = {"metadata": {"labels": {"app": f"rmf-{name}"}}, "spec": spec}
    return part(name, image, ros="None", ports=[{"containerPort": port}], template=template, **fields)


def _ros_modules() -> list[Json]:
    key = {"pod": {"volumes": [KEY_FILE]}, "volumeMounts": [mount("key", "/etc/config", readOnly=True)]}
    site = {"pod": {"hostNetwork": True}}
    adapter = "ros2 run rmf_demos_fleet_adapter fleet_adapter -c $(FLEET_ADAPTER_CONFIG) -n $(NAV_GRAPH)"
    return [
        _core(
            "traffic-schedule",
            "ros2 run rmf_traffic_ros2 rmf_traffic_schedule --ros-args -p use_sim_time:=$(RMF_USE_SIM_TIME)",
        ),
        _core("traffic-blockade", "ros2 run rmf_traffic_ros2 rmf_traffic_blockade"),
        _core("lift-supervisor", "ros2 run rmf_fleet_adapter lift_supervisor"),
        _core(
            "task-dispatcher",
            "ros2 run rmf_task_ros2 rmf_task_dispatcher --ros-args -p bidding_time_window:=$(RMF_BIDDING_TIME_WINDOW)",
            env=env(RMF_BIDDING_TIME_WINDOW="2.0", RMF_SERVER_URI=SERVER),
        ),
        _core(
            "trajectory-visualizer",
            "ros2 launch rmf_visualization visualization.launch.xml headless:=1",
            ports=[{"containerPort": 8006}],
            **key,
        ),
        _core("building-map-server", "ros2 run rmf_building_map_tools building_map_server /maps/office.yaml", **site),
        _core("mutex-group-supervisor", "ros2 run rmf_fleet_adapter mutex_group_supervisor", **site),
        _core(
            "fleet-adapter",
            f"{adapter} --ros-args -p server_uri:=$(RMF_SERVER_URI)",
            env=env(RMF_SERVER_URI=SERVER, NAV_GRAPH="/maps/0.yaml", FLEET_ADAPTER_CONFIG="/config/tinyRobot.yaml"),
            **site,
        ),
        _core("api-server", "rmf_api_server", ports=[{"containerPort": 8000}], **key),
    ]


def _web_modules() -> list[Json]:
    zone = {"name": "zone", "configMap": {"name": "cm-tz-singapore"}}
    local_time = mount("zone", "/etc/localtime", subPath="localtime", readOnly=True)
    data = {"name": "data", "persistentVolumeClaim": {"claimName": "keycloak-db"}}
    database = [_secret("POSTGRES_USER", "DB_USER"), _secret("POSTGRES_PASSWORD", "DB_PASSWORD")]
    login = [
        *env(KC_DB="postgres", KC_DB_URL="jdbc:postgresql://keycloak-db/keycloak"),
        _secret("KC_DB_PASSWORD", "DB_PASSWORD"),
    ]
    return [
        _web("dashboard", f"{RMF}/dashboard", 80, env=env(RMF_SERVER_URL="https://rmf.example/rmf/api/v1")),
        _web(
            "keycloak-db",
            "postgres:16.2",
            5432,
            data,
            zone,
            env=[*database, *env(POSTGRES_DB="keycloak")],
            volumeMounts=[mount("data", "/var/lib/postgresql/data"), local_time],
        ),
        _web(
            "keycloak",
            "keycloak/keycloak:24.0.5",
            8080,
            zone,
            args=["start", "--hostname-strict", "false"],
            env=login,
            volumeMounts=[local_time],
            readinessProbe={"httpGet": {"path": "/auth/realms/master", "port": 8080}},
        ),
    ]


def _ingress(path: str, name: str, port: int) -> Json:
    backend = {"service": {"name": name, "port": {"number": port}}}
    rule = {"host": "rmf.example", "http": {"paths": [{"path": path, "pathType": "Prefix", "backend": backend}]}}
    spec = {"ingressClassName": "nginx", "rules": [rule]}
    return {"apiVersion": "networking.k8s.io/v1", "kind": "Ingress", "metadata": {"name": name}, "spec": spec}


def open_rmf() -> Example:
    """Nine modules of ROS in domain 15 and three of the web, with the Services, secrets and Ingresses of their authors."""
    secret = {"DB_USER": "keycloak", "DB_PASSWORD": "example"}
    return Example(
        "Open-RMF: deployment template",
        "open-rmf/rmf_deployment_template",
        apps=[
            make_app(
                "open-rmf",
                "jazzy",
                *_ros_modules(),
                *_web_modules(),
                ros2={"domain": 15, "rmw": "rmw_cyclonedds_cpp"},
            )
        ],
        beside=[
            config_map("cyclonedds-configmap", **{"cyclonedds.xml": "<CycloneDDS/>"}),
            config_map("jwt-pub-key", **{"jwt-pub-key.pub": "none"}),
            config_map("cm-tz-singapore", localtime="none"),
            {"apiVersion": "v1", "kind": "Secret", "metadata": {"name": "keycloak-secret"}, "stringData": secret},
            {"kind": "PersistentVolumeClaim", "metadata": {"name": "keycloak-db"}},
            service("keycloak-db", {"app": "rmf-keycloak-db"}, 5432),
            service("keycloak", {"app": "rmf-keycloak"}, 8080),
            service("rmf-web-dashboard", {"app": "rmf-dashboard"}, 80),
            service("rmf-web-rmf-server", {"app": "rmf-api-server"}, 8000),
            service("rmf-trajectory-visualizer", {"app": "rmf-trajectory-visualizer"}, 8006),
            _ingress("/trajectory", "rmf-trajectory-visualizer", 8006),
            _ingress("/dashboard", "rmf-web-dashboard", 80),
        ],
        promises=[
            has_pod_fields("fleet-adapter", hostNetwork=True),
            has_pod_fields("building-map-server", hostNetwork=True),
            has_variables("traffic-schedule", ROS_DOMAIN_ID="15", RMW_IMPLEMENTATION="rmw_cyclonedds_cpp"),
            has_variables("task-dispatcher", RMF_SERVER_URI=SERVER),
            is_chosen_by("rmf-web-rmf-server", "api-server"),
            is_chosen_by("rmf-trajectory-visualizer", "trajectory-visualizer"),
            is_chosen_by("keycloak-db", "keycloak-db"),
            has_no_ros("keycloak"),
            has_container_fields("keycloak", args=["start", "--hostname-strict", "false"]),
            mounts("keycloak-db", "/var/lib/postgresql/data", {"persistentVolumeClaim": {"claimName": "keycloak-db"}}),
            share_a_domain(("traffic-schedule", ""), ("fleet-adapter", ""), ("api-server", "")),
        ],
    )
