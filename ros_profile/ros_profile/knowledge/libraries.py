"""Names of libraries and system interfaces in code that show access to hardware, real-time scheduling or a display."""

import re
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Library:
    """`gives`: hardware types (`serial`, `usb+camera`), or a role: `realtime`, `display`, `network`, `recording`."""

    gives: str
    model: str = ""
    interface: str = ""
    weight: float = 1.0


CPP_SYMBOLS: dict[str, Library] = {
    # serial ports
    r"serial::Serial\b": Library("serial"),
    r"(?:boost::)?asio::serial_port\b": Library("serial"),
    r"(?:Lib)?SerialPort::|QSerialPort\b|AsyncSerial\b|SerialStream\b": Library("serial"),
    r"cfset[io]?speed\b|B(?:9600|19200|38400|57600|115200|230400|460800|921600|1000000)\b": Library("serial"),
    r"PortHandler::getPortHandler\b": Library("serial", "dynamixel"),
    r"TermiosAgent\b|serial_driver::|SerialDriver\b": Library("serial", weight=0.7),
    r"modbus_new_rtu\b|LibSerial::|CYdLidar\b": Library("serial"),
    # CAN
    r"[PA]F_CAN\b|sockaddr_can\b": Library("can", interface="socketcan"),
    r"can(?:OpenChannel|Initialize[Ll]ibrary)\b|KvaserCan\b|PCANBasic\b|CAN_Initialize\b": Library("can"),
    r"can::(?:SocketCAN|ThreadedSocketCAN|DriverInterface)\w*|SocketCan(?:Receiver|Sender)\b": Library(
        "can", interface="socketcan"
    ),
    r"lely::(?:io::CanController|io::CanChannel|canopen)\b": Library("can", interface="canopen"),
    # pins
    r"gpiod_\w+|gpiod::chip\b": Library("gpio", interface="gpiod"),
    r"gpioInitialise\b|gpioSetMode\b|gpioWrite\b|pigpio_start\b": Library("gpio", interface="pigpio"),
    r"wiringPiSetup\w*|bcm2835_init\b|lgGpiochipOpen\b": Library("gpio"),
    # USB
    r"libusb_\w+": Library("usb", interface="libusb"),
    r"hid_(?:init|open|read)\b": Library("usb", interface="hid"),
    r"Phidget\w*_(?:create|open\w*|setDeviceSerialNumber)\b|Phidget\w*Handle\b": Library("usb", "phidget"),
    r"SDL_(?:Joystick|GameController)Open\b": Library("usb", "joystick", "hid"),
    r"js_event\b|JSIOCGNAME\b": Library("usb", "joystick", "hid"),
    # cameras with a USB library of their own
    r"rs2::(?:context|device|pipeline|sensor)\b": Library("usb+camera", "realsense"),
    r"dai::(?:Device|Pipeline)\b": Library("usb+camera", "oak"),
    r"k4a(?:::device|_device_open)\b": Library("usb+camera", "azure-kinect"),
    r"sl::Camera\b": Library("usb+camera", "zed"),
    r"Spinnaker::(?:System|Camera)\w*|FlyCapture2::Camera\b": Library("usb+camera", "flir"),
    r"openni::Device\b|openni2?_wrapper::|freenect_\w+|libfreenect2::|ob::(?:Device|Pipeline)\b": Library("usb+camera"),
    r"uvc_(?:open|find_device|start_streaming|init)\b": Library("usb+camera", interface="uvc"),
    r"ueye::|is_InitCamera\b|Pylon::|BGAPI2::": Library("usb+camera", weight=0.8),
    # cameras of the board or of the kernel
    r"VIDIOC_\w+|V4L2_PIX_FMT_\w+|v4l2_(?:format|buffer|capability)\b": Library("camera", interface="v4l2"),
    r"libcamera::(?:Camera|CameraManager)\w*": Library("camera", interface="libcamera"),
    r"MMAL_COMPONENT_\w+|mmal_component_create\b|raspicam::": Library("camera", "csi"),
    r"nvarguscamerasrc\b|Argus::": Library("camera", "csi"),
    # GPU
    r"cuda(?:Malloc|Memcpy|Stream|SetDevice|Free)\w*|cublas\w+|cudnn\w+": Library("gpu", "nvidia"),
    r"nvinfer1::|TensorRT\b|cv::cuda::|cv::dnn::DNN_TARGET_CUDA\b": Library("gpu", "nvidia"),
    r"torch::(?:kCUDA|cuda::)|VPI_BACKEND_CUDA\b|vpiStreamCreate\b": Library("gpu", "nvidia"),
    r"nvidia::isaac_ros::nitros\b|Nitros(?:Node|Image|TensorList|Publisher\w*|Subscriber\w*)\b": Library(
        "gpu", "nvidia"
    ),
    r"gl(?:DispatchCompute|CreateShader|ShaderSource|CompileShader)\b": Library("gpu", weight=0.8),
    r"cl::(?:Context|CommandQueue)\b|clCreateContext\w*": Library("gpu"),
    # roles
    r"SCHED_(?:FIFO|RR|DEADLINE)\b|mlockall\b|configure_sched_fifo\b|lock_memory\b": Library("realtime"),
    r"realtime_tools::": Library("realtime"),
    r"cv::(?:imshow|namedWindow)\b|cvNamedWindow\b|Q(?:Application|Widget|MainWindow)\b": Library("display"),
    r"rviz_common::(?:Display|Panel|Tool)\b|rviz::(?:Display|Panel|Tool)\b": Library("display"),
    r"rosbag2?(?:_cpp)?::(?:Bag|Writer|Reader|Recorder)\b": Library("recording"),
    r"async_web_server_cpp\b|httplib::|websocketpp\b|mqtt::async_client\b|Aws::\w+": Library("network"),
    r"ip::(?:udp|tcp)::(?:socket|endpoint|resolver)\b|urcl::|EtherCAT\b|ecrt_\w+": Library("network"),
    r"diagnostic_updater::Updater\b|diagnostic_aggregator\b": Library("diagnostics"),
    r"tc[gs]etattr\b": Library("terminal"),
    r"cv::VideoCapture\b": Library("video_file_or_camera"),
}
"""Patterns of qualified names in code, matched from their beginning. What a library gives is evidence, not proof: weights say how often."""

DEVICE_PATH = (
    r"/dev/(?:tty(?:USB|ACM|AMA|THS|S|O|mxc|UL|XRUSB)?[\w.-]{0,40}|serial/[\w./:-]{1,80}|video[\w-]{0,20}|input/[\w./-]{1,60}|"
    r"gpio[\w-]{0,20}|gpiochip\d*|i2c-\d+|spidev[\d.]+|ttyTHS\d|hidraw\d*|bus/usb[\w/]{0,30}|can\d+|nvhost[\w-]{0,30}|dri/[\w-]{1,30}|[a-z][\w-]{1,40})"
)
"""A path of a device node in a string literal."""

CAN_INTERFACE = r"^(?:v?s?l?can\d{1,2})$"
SYSFS_GPIO = r"/sys/class/gpio|/sys/devices/gpio"
CUDA_TEXT = r"^(?:cuda(?::\d+)?|gpu|GPU|TensorrtExecutionProvider|CUDAExecutionProvider)$|nvarguscamerasrc"
URL = r"^(?:https?|rtsp|wss?|mqtt|tcp|udp)://"


ROLE_SYMBOLS: tuple[tuple[re.Pattern[str], str], ...] = tuple(
    (re.compile(pattern), role)
    for pattern, role in (
        (
            r"^(?:SCHED_(?:FIFO|RR|DEADLINE)|mlockall|configure_sched_fifo|lock_memory|realtime_tools::|os\.sched_setscheduler)|^realtime_tools/",
            "realtime",
        ),
        (
            r"^cv2?(?:::|\.)(?:imshow|namedWindow)|^cvNamedWindow|^Q(?:Application|Widget|MainWindow)\b|^rviz\w*::|^(?:python_qt_binding|PyQt\d|PySide\d|tkinter|matplotlib\.pyplot|pyqtgraph|qt_gui|rqt_gui_py|pydot|pygraphviz|pyttsx3|gtts|playsound|luma)\b|^(?:QtWidgets|rviz_common|rviz)/",
            "display",
        ),
        (
            r"^(?:gz|ignition)/(?:transport|sim|gazebo|sensors|msgs)(?:/|\.hh)|^gazebo/|^webots/|^gz(?:\.|_)sim|^controller\.Robot|^(?:gymnasium|pybullet|mujoco|isaacgym|stable_baselines3)\b|^mujoco/|^G[ZA]_REGISTER_\w+_PLUGIN",
            "simulation",
        ),
        (r"^rosbag2?(?:_cpp|_py)?(?:::|\.)(?:Bag|Writer|Reader|Recorder|Sequential\w+)", "recording"),
        (
            r"^(?:async_web_server_cpp|httplib|websocketpp|mqtt::|Aws::)|^(?:tornado|websockets?|flask|fastapi|paho|requests|autobahn|twisted|grpc|zenoh|eclipse_zenoh|rosbridge_library|openai|ollama|langchain|boto3)\b|^mqtt/|^pymodbus\.server\b",
            "network",
        ),
        (r"^tc[gs]etattr$|^termios\b|^(?:curses|pynput|msvcrt)\b", "terminal"),
        (r"^diagnostic_updater::Updater", "diagnostics"),
        (r"^(?:psutil|ntplib|subprocess\.Popen)\b", "host_monitor"),
        (r"^(?:argparse\.ArgumentParser|ros2cli|click)\b", "command_line"),
    )
)
"""Library name → role it shows, for C++ and Python alike."""
