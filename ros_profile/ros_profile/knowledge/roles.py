"""What ROS types, plug-in base classes, dependencies and words say of a node's role.

Every entry is a statement about ROS, not about a package under test. Classes in short: rt realtime, sd sensor_data,
sy system_default, be best_effort.
"""

import re

COMMAND_TYPES = frozenset(
    {
        *("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped", "trajectory_msgs/msg/JointTrajectory"),
        *("ackermann_msgs/msg/AckermannDrive", "ackermann_msgs/msg/AckermannDriveStamped", "control_msgs/msg/JointJog"),
        *("mavros_msgs/msg/PositionTarget", "mavros_msgs/msg/AttitudeTarget", "mavros_msgs/msg/OverrideRCIn"),
        *("px4_msgs/msg/TrajectorySetpoint", "px4_msgs/msg/OffboardControlMode", "px4_msgs/msg/ActuatorMotors"),
        *("actuator_msgs/msg/Actuators", "control_msgs/msg/GripperCommand", "trajectory_msgs/msg/JointTrajectoryPoint"),
        *("moveit_msgs/msg/ServoStatus", "geometry_msgs/msg/Wrench", "geometry_msgs/msg/WrenchStamped"),
    }
)
"""Types that move something when they arrive; a stamped twist or wrench is also a measurement."""
MEASURED_COMMAND_TYPES = frozenset(
    {"geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Wrench", "geometry_msgs/msg/WrenchStamped"}
)
COMMAND_TOPIC = re.compile(
    r"(?:^|[/_])(?:cmd|cmds|command|commands|setpoint|set_point|set_(?:position|velocity|speed|angle|effort|torque)|twist_mux|e_?stop|duty_cycle|throttle|steering|ref|reference|desired)(?:[/_]|$|\d)"
)
SIGNAL_TYPES = frozenset({"std_msgs/msg/String", "std_msgs/msg/Empty", "std_msgs/msg/Bool"})
"""A command in one of these names an action or switches something; it carries no set point."""
ACTUATOR_TOPIC = re.compile(
    r"(?:^|[/_])(?:motors?|thrusters?|thrust|pwm|servos?|actuators?|brakes?|gripper|spin|drive|move|stop|halt|kill|kill_?switch|deadman|emergency|heartbeat)(?:[/_](?:raw|values?|speeds?|goals?|targets?|inputs?|left|right|front|back|rear|\d+))*$"
)
"""What moves or stops, at the end of a topic's name; `motor_temperature` is a measurement."""
COMMAND_TYPE_NAME = re.compile(
    r"/msg/\w*(?:Cmd|Command|Set_?[Pp]oint|Control|Motor|Thrust|Actuator|Servo|Steering|Throttle|Drive)(?!\w*(?:Stat|Feedback|Info|Report|Response|Telemetry|Diag|Temp|Current))\w*$"
)
MEASURED_TYPE_NAME = re.compile(
    r"/msg/\w*(?:I[Mm][Uu]|G[Pp][Ss]|G[Nn][Ss][Ss]|D[Vv][Ll]|Depth|Sonar|Range|Ultrasonic|Distance|Scan|Lidar|Encoder|Temperature|Pressure|Humidity|Sensor|Altitude)\w*$"
)
"""Messages of a repository's own, by what their names tell."""
MEASURED_TOPIC = re.compile(
    r"(?:^|[/_])(?:imu|gps|gnss|dvl|depth|sonars?|ranges?|ultrasonic|distances?|encoders?|ticks|temperature|pressure|humidity|altitude|yaw|compass|sensors?|lidar|scan)(?:[/_](?:data|raw|values?|left|right|front|back|rear|\d+))*$"
)
"""Measurements that are sent as plain numbers or in messages of the repository's own."""
MOTION_ACTIONS = re.compile(
    r"/action/(?:FollowPath|Spin|BackUp|DriveOnHeading|AssistedTeleop|FollowJointTrajectory|GripperCommand|DockRobot|UndockRobot|FollowObject|JointTrajectory|PointHead|SingleJointPosition)$"
)
PLANNING_ACTIONS = re.compile(
    r"/action/(?:Navigate\w*|Compute\w*|FollowWaypoints|FollowGPSWaypoints|MoveGroup|Plan\w*|MoveBase|Pickup|Place|ExecuteTrajectory|SmoothPath|ComputeAndTrackRoute)$"
)

SENSOR_TYPES = frozenset(
    {
        *("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"),
        *("sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/PointCloud", "sensor_msgs/msg/LaserScan"),
        *("sensor_msgs/msg/MultiEchoLaserScan", "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField"),
        *("sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/Range", "sensor_msgs/msg/Temperature"),
        *("sensor_msgs/msg/FluidPressure", "sensor_msgs/msg/RelativeHumidity", "sensor_msgs/msg/Illuminance"),
        *("sensor_msgs/msg/TimeReference", "stereo_msgs/msg/DisparityImage", "radar_msgs/msg/RadarScan"),
        *("audio_common_msgs/msg/AudioData", "velodyne_msgs/msg/VelodyneScan", "nmea_msgs/msg/Sentence"),
    }
)
INTERPRETED = re.compile(
    r"^(?:vision_msgs/msg/|geometry_msgs/msg/PoseWithCovariance(?:Stamped)?$|nav_msgs/msg/OccupancyGrid$|octomap_msgs/msg/|costmap\w*/msg/|\w+/msg/\w*(?:Detection|Detections|BoundingBox|Track|Obstacle|Marker\w*Detection|DetectionArray|Object)\w*$)"
)
"""What perception, localisation and mapping make of sensor streams."""
POSE_TYPES = frozenset(
    {"geometry_msgs/msg/PoseWithCovarianceStamped", "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry"}
)
DISPLAY_TYPES = frozenset(
    {"visualization_msgs/msg/Marker", "visualization_msgs/msg/MarkerArray", "visualization_msgs/msg/InteractiveMarker"}
)
STATE_TYPES = frozenset(
    {"sensor_msgs/msg/JointState", "control_msgs/msg/DynamicJointState", "sensor_msgs/msg/BatteryState"}
)
FIELDBUS_TYPES = frozenset({"can_msgs/msg/Frame", "canopen_interfaces/msg/COData"})
JOY = "sensor_msgs/msg/Joy"

PLUGIN_BASES: tuple[tuple[re.Pattern[str], str], ...] = tuple(
    (re.compile(pattern), role)
    for pattern, role in (
        (
            r"^(?:controller_interface|effort_controllers|forward_command_controller|joint_trajectory_controller)::|^controller_interface\b|ChainableControllerInterface",
            "controller",
        ),
        (
            r"^hardware_interface::(?:System|Actuator|Sensor|RobotHW)|^hardware_interface::RobotHW|HardwareInterface$|^(?:robot_hw|combined_robot_hw)::",
            "hardware",
        ),
        (
            r"^nav2_core::(?:Controller|Behavior|GoalChecker|ProgressChecker|PathHandler)\b|^nav_core2?::(?:BaseLocalPlanner|RecoveryBehavior|LocalPlanner)|^mbf_\w+::\w*(?:Controller|Recovery)",
            "motion",
        ),
        (r"^dwb_core::|^mppi::|^opennav_docking_core::|^nav2_behaviors?::|^nav2_behaviors::TimedBehavior", "motion"),
        (
            r"^nav2_core::(?:GlobalPlanner|Smoother|WaypointTaskExecutor|NavigatorBase|BehaviorTreeNavigator)|^nav_core2?::(?:BaseGlobalPlanner|GlobalPlanner)|^mbf_\w+::\w*Planner|^planning_interface::|^nav2_route::|^moveit_controller_manager::|^moveit_ros_control_interface::|^kinematics::KinematicsBase|^planning_request_adapter::|^move_group::|^planning_pipeline",
            "planner",
        ),
        (r"^BT::|BtActionNode|BtServiceNode|behavior_tree", "planner"),
        (
            r"(?:^|::)(?:costmap_2d|nav2_costmap_2d)::(?:Layer|CostmapLayer)|^nav2_costmap_2d::|^occupancy_map_monitor::",
            "layer",
        ),
        (
            r"^image_transport::|^point_cloud_transport::|^pcl_ros::|^filters::FilterBase|^laser_filters::|^grid_map",
            "filter",
        ),
        (
            r"^(?:rviz_common|rviz|rviz_default_plugins|rviz_rendering)::|^rqt_gui\w*(?:::|\.)|^qt_gui|^rqt_\w+::",
            "display",
        ),
        (
            r"^gazebo(?:_ros)?::|^(?:gz::sim|ignition::gazebo)|^(?:gz|ignition)::sensors|^webots|^mujoco\w*::",
            "simulator",
        ),
        (r"^ros2cli|CommandExtension|VerbExtension", "tool"),
        (r"^diagnostic_aggregator::|^diagnostic_updater::DiagnosticTask", "monitor"),
        (r"^rosbag2?_|^rosbag2_storage", "tool"),
    )
)
"""Base class → role; the class that is loaded takes the role of what loads it."""

REPORTING_CONTROLLER = re.compile(
    r"controller_interface::\w*Controller<(?:hardware_interface::)?\w*(?:State|Sensor)Interface\b[^,]*>?$"
)
"""A controller of ROS 1 that is given states only: it commands nothing."""

DEPENDENCIES: tuple[tuple[re.Pattern[str], str], ...] = tuple(
    (re.compile(rf"^(?:{pattern})$"), role)
    for pattern, role in (
        (
            r"controller_interface|controller_manager|hardware_interface|realtime_tools|ros2_control|ros_control|joint_trajectory_controller|ros2_controllers|transmission_interface|effort_controllers|position_controllers|velocity_controllers|control_toolbox|forward_command_controller|diff_drive_controller",
            "control",
        ),
        (
            r"ackermann_msgs|twist_mux|teleop_twist_\w+|joy|joy_linux|joy_teleop|moveit_servo|velocity_controllers|geometry_twist",
            "command",
        ),
        (
            r"nav2_core|nav_core|base_local_planner|dwb_core|nav2_controller|dwa_local_planner|clear_costmap_recovery",
            "navigation_core",
        ),
        (
            r"socketcan_\w+|ros2_socketcan\w*|can_msgs|canopen_\w+|lely_\w+|kvaser_\w+|ethercat_\w+|ecrt|libkvaser\w*",
            "fieldbus",
        ),
        (
            r"cv_bridge|image_transport\w*|pcl_ros|pcl_conversions|vision_msgs|image_geometry|message_filters|stereo_msgs|depth_image_proc|image_proc|camera_info_manager\w*|laser_geometry|sensor_msgs_py|vision_opencv|perception_pcl|libpcl-\w+|nmea_msgs|radar_msgs|depthai\w*|librealsense2?|isaac_ros_\w+|laser_proc|urg_c|velodyne_msgs|imu_\w+|tf2_sensor_msgs|point_cloud_transport",
            "sensing",
        ),
        (r"sensor_msgs", "sensor_msgs"),
        (r"geometry_msgs", "geometry_msgs"),
        (
            r"moveit_\w+|behaviortree_cpp\w*|behaviortree_cpp|nav2_behavior_tree|ompl|rmf_\w+|free_fleet\w*|smach\w*|flexbe\w*|py_trees\w*|nav2_msgs|actionlib|rclcpp_action|nav2_lifecycle_manager",
            "coordination",
        ),
        (
            r"rosbridge_\w+|rosauth|libmosquitto-dev|paho-mqtt-\w+|python3-(?:paho-mqtt|tornado|twisted|flask|websocket\w*|requests|autobahn|fastapi\w*|pymongo|bson|pil)|websocketpp|libwebsocketpp-dev|async_web_server_cpp|grpc|nlohmann-json-dev|eclipse-zenoh",
            "network",
        ),
        (
            r"rviz|rviz2|rviz_common|rviz_rendering|rviz_default_plugins|rqt_\w+|qt_gui\w*|python_qt_binding|python3-(?:qt5|pyqt5|matplotlib|pydot|tk)\w*|python-qt\w*|qtbase5-dev|libqt5\w*|qt_dotgraph|interactive_markers|libogre-dev",
            "display",
        ),
        (r"gazebo_\w+|gz_\w+|ros_gz\w*|ros_ign\w*|gazebo|webots_\w+|stage_ros|stage", "simulation"),
        (
            r"ros2cli|rosbag2?\w*|rosbag|ros2\w+|diagnostic_aggregator|python3-(?:psutil|ntplib)|lm-sensors|ntpdate|sysstat|aws_\w+|cloudwatch\w*",
            "tool",
        ),
        (r"diagnostic_msgs|diagnostic_updater", "diagnostics"),
    )
)

WORDS: tuple[tuple[str, str], ...] = (
    (
        "display",
        "viz rviz rqt plot plotter viewer view gui dashboard visualization visualizer visualisation panel panels hmi web foxglove video_server tts speaker announcer oled lcd",
    ),
    (
        "tool",
        "description cli bag rosbag rosbag2 bags dataset record recorder logger logging calibration calibrate benchmark benchmarks install resources meshes tool tools utils test tests testing profiler urdf assets publisher_tool",
    ),
    ("monitor", "diagnostic diagnostics aggregator monitor monitors watchdog health stats statistics status"),
    (
        "simulation",
        "sim simulator simulation simulated sil hil gazebo gz fake dummy mock loopback emulator webots stage world worlds",
    ),
    ("interfaces", "msgs interfaces srvs messages"),
    (
        "teleop",
        "teleop manual joy joystick spacenav remote rc pad deadman keyboard gamepad operator estop e_stop emergency",
    ),
    (
        "control",
        "controller controllers control controls failsafe servo motor motors mux smoother behaviors recovery local_planner docking drive base hardware hw actuator gripper collision safety follower pursuit arm wheel wheels chassis pid balance thruster thrusters propulsion autopilot offboard steering manipulator joints",
    ),
    ("fieldbus", "can canopen canbus socketcan ethercat fieldbus profinet"),
    (
        "sensing",
        "camera cam lidar laser scan scanner imu gps gnss navsat image images depth stereo pointcloud cloud pcl vision sonar radar range ultrasonic rgbd thermal uvc webcam encoder encoders battery barometer magnetometer force torque ft microphone audio v4l2 dvl tof altimeter hydrophone filter filters proc sensor sensors",
    ),
    (
        "estimation",
        "slam localization localisation localizer odometry odom ekf ukf estimation estimator fusion mapping costmap octomap icp loam lio vio kalman pose cartographer",
    ),
    (
        "perception",
        "perception detection detector detect segmentation tracking tracker recognition classifier apriltag apriltags aruco fiducial fiducials face human ocr inference deep_learning yolo",
    ),
    (
        "planning",
        "planner planning route router path navigator bt behavior_tree global_planner moveit mission task tasks waypoint waypoints commander exploration explore patrol executive statemachine state_machine fsm brain decision strategy",
    ),
    (
        "coordination",
        "lifecycle manager server fleet adapter coordinator orchestrator scheduler dispatcher rmf interaction dialogue dialog hri",
    ),
    ("network", "bridge api mqtt modbus gateway websocket http client cloud zenoh llm gpt chat"),
    ("io", "gpio relay io plc digital analog led leds light lights lamp lamps neopixel buzzer siren"),
)
"""Role → words of package and executable names; a phrase with an underscore must stand in the name as it is."""
