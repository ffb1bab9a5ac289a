"""Well-known packages by name. A layer of its own: `--no-curated` leaves it out, and no rule outside names a package.

From what the packages document: what their node does, and which device it opens by default.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Entry:
    qos_class: str
    hardware: tuple[str, ...] = ()
    model: str = ""

    def text(self) -> str:
        return " ".join((self.qos_class, *self.hardware))


def _entries(qos_class: str, names: str, *hardware: str, model: str = "") -> dict[str, Entry]:
    return dict.fromkeys(names.split(), Entry(qos_class, hardware, model))


PACKAGES: dict[str, Entry] = {
    # commands and loops
    **_entries(
        "realtime",
        "controller_manager ros2_control_node joint_trajectory_controller diff_drive_controller ackermann_steering_controller",
    ),
    **_entries(
        "realtime",
        "effort_controllers velocity_controllers position_controllers forward_command_controller mecanum_drive_controller tricycle_controller",
    ),
    **_entries(
        "realtime",
        "nav2_controller nav2_bringup nav2_behaviors nav2_velocity_smoother nav2_collision_monitor nav2_mppi_controller nav2_graceful_controller",
    ),
    **_entries(
        "realtime",
        "nav2_regulated_pure_pursuit_controller nav2_rotation_shim_controller opennav_docking dwb_core dwb_controller move_base move_base_flex",
    ),
    **_entries(
        "realtime",
        "dwa_local_planner base_local_planner teb_local_planner eband_local_planner twist_mux cmd_vel_mux yocs_cmd_vel_mux moveit_servo",
    ),
    **_entries(
        "realtime",
        "teleop_twist_keyboard key_teleop mouse_teleop teleop_twist_joy joy_teleop twist_stamper wiimote mavros franka_hardware ur_robot_driver",
    ),
    **_entries("realtime", "joy joy_linux spacenav spacenav_node ps3joy", "usb", model="joystick"),
    **_entries(
        "realtime",
        "rosserial_python rosserial_server micro_ros_agent kobuki_node kobuki_driver roboclaw_node turtlebot3_node odrive_node create_driver",
        "serial",
    ),
    **_entries(
        "realtime",
        "dynamixel_hardware dynamixel_workbench_controllers dynamixel_hardware_interface",
        "serial",
        model="dynamixel",
    ),
    **_entries(
        "realtime",
        "ros2_socketcan socketcan_bridge canopen_core canopen_master_driver canopen_proxy_driver canopen_402_driver",
        "can",
    ),
    # sensors
    **_entries(
        "sensor_data",
        "usb_cam uvc_camera libuvc_camera realsense2_camera depthai_ros_driver astra_camera orbbec_camera",
        "usb",
        "camera",
    ),
    **_entries(
        "sensor_data",
        "spinnaker_camera_driver pointgrey_camera_driver azure_kinect_ros_driver openni2_camera freenect_camera",
        "usb",
        "camera",
    ),
    **_entries("sensor_data", "zed_wrapper zed_components", "usb", "camera", "gpu", model="zed"),
    **_entries("sensor_data", "v4l2_camera camera_ros raspicam_node raspicam2_node cv_camera", "camera"),
    **_entries(
        "sensor_data",
        "rplidar_ros sllidar_ros2 ydlidar_ros_driver ydlidar_ros2_driver ldlidar_stl_ros2 hls_lfcd_lds_driver ld08_driver urg_node",
        "serial",
    ),
    **_entries(
        "sensor_data",
        "nmea_navsat_driver ublox_gps bno055 microstrain_inertial_driver xsens_mti_driver um7 razor_imu_9dof vectornav",
        "serial",
    ),
    **_entries(
        "sensor_data",
        "phidgets_spatial phidgets_temperature phidgets_analog_inputs phidgets_digital_inputs phidgets_magnetometer",
        "usb",
        model="phidget",
    ),
    **_entries(
        "sensor_data",
        "velodyne_driver velodyne_pointcloud ouster_ros sick_scan sick_scan_xd sick_safetyscanners sick_safetyscanners2 livox_ros_driver2 hesai_ros_driver",
    ),
    **_entries(
        "sensor_data",
        "image_proc depth_image_proc stereo_image_proc image_rotate pointcloud_to_laserscan laser_filters pcl_ros imu_filter_madgwick",
    ),
    **_entries(
        "sensor_data",
        "imu_complementary_filter robot_localization slam_toolbox cartographer_ros gmapping slam_gmapping hector_mapping rtabmap_slam",
    ),
    **_entries(
        "sensor_data",
        "rtabmap_odom rtabmap_ros amcl nav2_amcl nav2_costmap_2d costmap_2d octomap_server apriltag_ros ar_track_alvar aruco_ros",
    ),
    **_entries(
        "sensor_data",
        "darknet_ros yolo_ros isaac_ros_visual_slam isaac_ros_apriltag isaac_ros_tensor_rt isaac_ros_triton isaac_ros_nitros nvblox_ros",
        "gpu",
    ),
    # services, plans, bridges
    **_entries(
        "system_default",
        "nav2_planner nav2_smoother nav2_bt_navigator nav2_waypoint_follower nav2_map_server nav2_lifecycle_manager nav2_route",
    ),
    **_entries(
        "system_default",
        "nav2_navfn_planner nav2_smac_planner nav2_theta_star_planner navfn global_planner carrot_planner map_server robot_state_publisher",
    ),
    **_entries(
        "system_default",
        "moveit_ros_move_group moveit_ros_planning rosbridge_server rosapi ros1_bridge domain_bridge mqtt_client mqtt_bridge foxglove_bridge",
    ),
    **_entries(
        "system_default",
        "rmf_fleet_adapter rmf_traffic_ros2 rmf_task_ros2 free_fleet free_fleet_adapter smach_ros flexbe_onboard tf2_ros nav2_simple_commander",
    ),
    # display, tools, simulation
    **_entries(
        "best_effort",
        "rviz rviz2 rqt_gui rqt_graph rqt_plot rqt_image_view plotjuggler_ros image_view web_video_server rosbag rosbag2_transport joint_state_publisher_gui",
    ),
    **_entries(
        "best_effort",
        "gazebo_ros ros_gz_sim ros_gz_bridge ros_ign_gazebo stage_ros stage_ros2 webots_ros2_driver turtlesim fake_localization nav2_loopback_sim",
    ),
    **_entries(
        "best_effort",
        "diagnostic_aggregator diagnostic_common_diagnostics camera_calibration tf2_tools rosbag2_py rqt_robot_monitor rviz_imu_plugin",
    ),
}
