"""What well-known nodes publish, take and serve, for edges to nodes whose source is not in the workspace.

Part of the curated layer, so `--no-curated` leaves it out. Keys are `package/executable` or the class of a component;
names are as in the node's own code, before remaps. `>` publishes, `<` subscribes, `?` calls, `!` serves.
"""

from typing import Final

INTERFACES: Final[dict[str, str]] = {
    "robot_state_publisher/robot_state_publisher": "< joint_states sensor_msgs/msg/JointState, > robot_description std_msgs/msg/String",
    "joint_state_publisher/joint_state_publisher": "> joint_states sensor_msgs/msg/JointState, < robot_description std_msgs/msg/String",
    "joint_state_publisher_gui/joint_state_publisher_gui": "> joint_states sensor_msgs/msg/JointState, < robot_description std_msgs/msg/String",
    "joy/joy_node": "> joy sensor_msgs/msg/Joy, < joy/set_feedback sensor_msgs/msg/JoyFeedback",
    "joy/game_controller_node": "> joy sensor_msgs/msg/Joy, < joy/set_feedback sensor_msgs/msg/JoyFeedback",
    "joy_linux/joy_linux_node": "> joy sensor_msgs/msg/Joy, < set_feedback sensor_msgs/msg/JoyFeedbackArray",
    "teleop_twist_joy/teleop_node": "< joy sensor_msgs/msg/Joy, > cmd_vel geometry_msgs/msg/Twist",
    "joy_teleop/joy_teleop": "< joy sensor_msgs/msg/Joy",
    "teleop_twist_keyboard/teleop_twist_keyboard": "> cmd_vel geometry_msgs/msg/Twist",
    "usb_cam/usb_cam_node_exe": "> image_raw sensor_msgs/msg/Image, > camera_info sensor_msgs/msg/CameraInfo",
    "usb_cam/usb_cam_node": "> ~/image_raw sensor_msgs/msg/Image, > ~/camera_info sensor_msgs/msg/CameraInfo",
    "v4l2_camera/v4l2_camera_node": "> image_raw sensor_msgs/msg/Image, > camera_info sensor_msgs/msg/CameraInfo",
    "camera_ros/camera_node": "> ~/image_raw sensor_msgs/msg/Image, > ~/camera_info sensor_msgs/msg/CameraInfo",
    "cartographer_ros/cartographer_node": "< scan sensor_msgs/msg/LaserScan, < imu sensor_msgs/msg/Imu, < odom nav_msgs/msg/Odometry, "
    "> submap_list cartographer_ros_msgs/msg/SubmapList, ! submap_query cartographer_ros_msgs/srv/SubmapQuery",
    "cartographer_ros/cartographer_occupancy_grid_node": "< submap_list cartographer_ros_msgs/msg/SubmapList, "
    "? submap_query cartographer_ros_msgs/srv/SubmapQuery, > map nav_msgs/msg/OccupancyGrid",
    "cartographer_ros/occupancy_grid_node": "< submap_list cartographer_ros_msgs/msg/SubmapList, "
    "? submap_query cartographer_ros_msgs/srv/SubmapQuery, > map nav_msgs/msg/OccupancyGrid",
    "imu_filter_madgwick/imu_filter_madgwick_node": "< imu/data_raw sensor_msgs/msg/Imu, < imu/mag sensor_msgs/msg/MagneticField, > imu/data sensor_msgs/msg/Imu",
    "imu_complementary_filter/complementary_filter_node": "< imu/data_raw sensor_msgs/msg/Imu, < imu/mag sensor_msgs/msg/MagneticField, > imu/data sensor_msgs/msg/Imu",
    "imu_filter_madgwick/ImuFilterNodelet": "< imu/data_raw sensor_msgs/msg/Imu, < imu/mag sensor_msgs/msg/MagneticField, > imu/data sensor_msgs/msg/Imu",
    "image_proc::DebayerNode": "< image_raw sensor_msgs/msg/Image, > image_mono sensor_msgs/msg/Image, > image_color sensor_msgs/msg/Image",
    "image_proc::RectifyNode": "< image sensor_msgs/msg/Image, < camera_info sensor_msgs/msg/CameraInfo, > image_rect sensor_msgs/msg/Image",
    "image_proc::ResizeNode": "< image/image_raw sensor_msgs/msg/Image, < image/camera_info sensor_msgs/msg/CameraInfo, "
    "> resize/image_raw sensor_msgs/msg/Image, > resize/camera_info sensor_msgs/msg/CameraInfo",
    "depth_image_proc::ConvertMetricNode": "< image_raw sensor_msgs/msg/Image, > image sensor_msgs/msg/Image",
    "depth_image_proc::PointCloudXyzNode": "< image_rect sensor_msgs/msg/Image, < camera_info sensor_msgs/msg/CameraInfo, > points sensor_msgs/msg/PointCloud2",
    "depth_image_proc::PointCloudXyziNode": "< depth/image_rect sensor_msgs/msg/Image, < intensity/image_rect sensor_msgs/msg/Image, "
    "< intensity/camera_info sensor_msgs/msg/CameraInfo, > points sensor_msgs/msg/PointCloud2",
    "depth_image_proc::PointCloudXyzrgbNode": "< rgb/image_rect_color sensor_msgs/msg/Image, < rgb/camera_info sensor_msgs/msg/CameraInfo, "
    "< depth_registered/image_rect sensor_msgs/msg/Image, > points sensor_msgs/msg/PointCloud2",
    "depth_image_proc::RegisterNode": "< depth/image_rect sensor_msgs/msg/Image, < depth/camera_info sensor_msgs/msg/CameraInfo, "
    "< rgb/camera_info sensor_msgs/msg/CameraInfo, > depth_registered/image_rect sensor_msgs/msg/Image, > depth_registered/camera_info sensor_msgs/msg/CameraInfo",
    "pointcloud_to_laserscan/pointcloud_to_laserscan_node": "< cloud_in sensor_msgs/msg/PointCloud2, > scan sensor_msgs/msg/LaserScan",
    "depthimage_to_laserscan/depthimage_to_laserscan_node": "< depth sensor_msgs/msg/Image, < depth_camera_info sensor_msgs/msg/CameraInfo, > scan sensor_msgs/msg/LaserScan",
    "velodyne_driver/velodyne_driver_node": "> velodyne_packets velodyne_msgs/msg/VelodyneScan",
    "velodyne_pointcloud/velodyne_transform_node": "< velodyne_packets velodyne_msgs/msg/VelodyneScan, > velodyne_points sensor_msgs/msg/PointCloud2",
    "velodyne_laserscan/velodyne_laserscan_node": "< velodyne_points sensor_msgs/msg/PointCloud2, > scan sensor_msgs/msg/LaserScan",
    "robot_localization/navsat_transform_node": "< imu sensor_msgs/msg/Imu, < gps/fix sensor_msgs/msg/NavSatFix, < odometry/filtered nav_msgs/msg/Odometry, "
    "> odometry/gps nav_msgs/msg/Odometry",
    "slam_toolbox/async_slam_toolbox_node": "< /scan sensor_msgs/msg/LaserScan, > /map nav_msgs/msg/OccupancyGrid",
    "slam_toolbox/sync_slam_toolbox_node": "< /scan sensor_msgs/msg/LaserScan, > /map nav_msgs/msg/OccupancyGrid",
    "map_server/map_server": "> map nav_msgs/msg/OccupancyGrid, ! static_map nav_msgs/srv/GetMap",
    "amcl/amcl": "< scan sensor_msgs/msg/LaserScan, < map nav_msgs/msg/OccupancyGrid, < initialpose geometry_msgs/msg/PoseWithCovarianceStamped, "
    "> amcl_pose geometry_msgs/msg/PoseWithCovarianceStamped, > particlecloud geometry_msgs/msg/PoseArray",
    "move_base/move_base": "> cmd_vel geometry_msgs/msg/Twist, < map nav_msgs/msg/OccupancyGrid, < odom nav_msgs/msg/Odometry",
    "urg_node/urg_node_driver": "> scan sensor_msgs/msg/LaserScan",
    "rplidar_ros/rplidar_node": "> scan sensor_msgs/msg/LaserScan",
    "hls_lfcd_lds_driver/hlds_laser_publisher": "> scan sensor_msgs/msg/LaserScan",
    "ld08_driver/ld08_driver": "> scan sensor_msgs/msg/LaserScan",
}
