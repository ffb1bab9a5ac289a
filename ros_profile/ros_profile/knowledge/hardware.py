"""What shows that a program opens a device: dependencies, Python libraries, device paths, build files, udev subsystems.

Each entry: pattern, what it gives (`usb+camera` gives both), weight = how often it means that the package itself opens
the device. Only what a process opens itself counts: a package that talks to a driver by topics needs no device.
"""

import re
from dataclasses import dataclass

from ros_profile.knowledge.libraries import CPP_SYMBOLS, Library

TYPES = ("serial", "usb", "camera", "can", "gpio", "gpu")


@dataclass(frozen=True, slots=True)
class Sign:
    pattern: re.Pattern[str]
    gives: tuple[str, ...]
    weight: float
    model: str = ""
    interface: str = ""


def _signs(
    *rows: tuple[str, str, float] | tuple[str, str, float, str] | tuple[str, str, float, str, str],
) -> tuple[Sign, ...]:
    return tuple(Sign(re.compile(row[0]), tuple(row[1].split("+")), row[2], *row[3:]) for row in rows)


_HARDWARE_GIVES = {"serial", "usb", "camera", "can", "gpio", "gpu", "usb+camera"}


def _of_library(pattern: str, library: Library) -> Sign:
    return Sign(
        re.compile(f"^(?:{pattern})"),
        tuple(library.gives.split("+")),
        0.9 * library.weight,
        library.model,
        library.interface,
    )


SYMBOLS: tuple[Sign, ...] = (
    *(_of_library(pattern, library) for pattern, library in CPP_SYMBOLS.items() if library.gives in _HARDWARE_GIVES),
    *_signs(
        (r"^serial\.(?:Serial|serial_for_url|rs485)|^serial_asyncio\.|^pyserial", "serial", 0.9),
        (r"^(?:dynamixel_sdk\.)?PortHandler$|^dynamixel_sdk\.PortHandler", "serial", 0.9, "dynamixel"),
        (
            r"^minimalmodbus\.|^pymodbus\.(?:\w+\.)*(?:Async)?ModbusSerialClient|^scservo_sdk\.PortHandler",
            "serial",
            0.9,
        ),
        (r"^rplidar\.RPLidar|^ydlidar\.|^pyvesc\.|^roboclaw\w*\.|^pyfirmata2?\.", "serial", 0.85),
        (r"^odrive\.find_", "usb", 0.85, "odrive"),
        (r"^can\.(?:interface\.Bus|Bus|ThreadSafeBus)$|^canopen\.Network$|^socketcan\.", "can", 0.9),
        (r"^(?:RPi|Jetson)\.GPIO\.(?:setup|setmode|output|input)|^GPIO\.(?:setup|setmode)", "gpio", 0.9),
        (r"^(?:gpiozero|pigpio|lgpio|gpiod|wiringpi|board\.D\d|digitalio|periphery)\b", "gpio", 0.85),
        (r"^usb\.(?:core|util)\.|^hid\.(?:device|Device)|^pyftdi\.|^usb1\.|^Phidget22\.|^libusb", "usb", 0.9),
        (r"^evdev\.InputDevice|^pygame\.joystick\.|^inputs\.get_gamepad", "usb", 0.85, "joystick", "hid"),
        (r"^pyrealsense2\.|^rs\.pipeline", "usb+camera", 0.9, "realsense"),
        (r"^depthai\.(?:Device|Pipeline)|^dai\.(?:Device|Pipeline)", "usb+camera", 0.9, "oak"),
        (r"^pyzed\.|^PySpin\.|^pypylon\.|^ids_peak\.|^openni\.|^freenect\.", "usb+camera", 0.85),
        (r"^picamera2?\.|^libcamera\.", "camera", 0.9, "csi"),
        (r"^v4l2\w*\.", "camera", 0.9, "", "v4l2"),
        (r"^cv2\.VideoCapture$|^cv::VideoCapture", "camera", 0.3),
        (r"^cv2\.VideoCapture\(number\)$", "usb", 0.6, "", "v4l2"),
        (
            r"^torch\.cuda\.|^cuda$|^cupy\.|^pycuda\.|^tensorrt\.|^numba\.cuda\.|^jax\.|^tensorflow\.config\.\w*gpu|^warp\.",
            "gpu",
            0.75,
            "nvidia",
        ),
        (r"^ultralytics\.(?:YOLO|RTDETR|SAM)|^torch\.hub\.load|^whisper\.load_model", "gpu", 0.55),
        (r"^pyopencl\.", "gpu", 0.9),
    ),
)
INCLUDES = _signs(
    (r"^serial/serial\.h|^boost/asio/serial_port|^libserial/|^SerialPort\.h|^asio/serial_port", "serial", 0.85),
    (r"^dynamixel_sdk/|^dynamixel_workbench", "serial", 0.85, "dynamixel"),
    (r"^linux/can(?:/|\.h)", "can", 0.45, "", "socketcan"),
    (r"(?:^|/)socket_?can\w*\.h|^socketcan_interface/|^canlib\.h|^PCANBasic\.h|^lely/coapp", "can", 0.85),
    (r"^pigpiod?_?\w*\.h|^wiringPi\w*\.h|^gpiod\.h\w*|^bcm2835\.h|^lgpio\.h|^JetsonGPIO", "gpio", 0.9),
    (
        r"^libusb|^hidapi|^phidget22\.h|^libuvc/|^usb\.h|^linux/joystick\.h|^linux/hidraw|^SDL\d?\.h|^SDL2/SDL",
        "usb",
        0.85,
    ),
    (r"^spnav\.h", "usb", 0.75, "spacemouse", "hid"),
    (r"^modbus/modbus-rtu\.h|^modbus-rtu\.h|^CYdLidar\.h|^SCServo\.h", "serial", 0.85),
    (r"^librealsense2/|^k4a/|^sl/Camera|^Spinnaker\.h|^OpenNI\.h|^pylon/|^libobsensor", "usb+camera", 0.85),
    (r"^linux/videodev2\.h|^dc1394/|^libcamera/|^interface/mmal|^raspicam/|^Argus/", "camera", 0.85),
    (
        r"^cuda(?:_runtime)?(?:_api)?\.h|^NvInfer|^cublas|^cudnn|^opencv2/cuda|^CL/cl|^vpi/|^npp\w*\.h",
        "gpu",
        0.85,
        "nvidia",
    ),
    (r"^isaac_ros_nitros/|^isaac_ros_managed_nitros/", "gpu", 0.8, "nvidia"),
)
DEPENDENCIES = _signs(
    (
        r"^(?:serial|serial_driver|libserial-dev|python3?-serial(?:-\w+)?|pyserial|python3-pyserial|serialport|libserialport-dev|dynamixel_sdk)$",
        "serial",
        0.7,
    ),
    (
        r"^(?:socketcan_interface|lely_core_libraries|lib(?:kvaser|pcan|socketcan)\w*[\w-]*|linux-can\w*|python3?-(?:can|canopen)|canopen_(?:core|master))$",
        "can",
        0.7,
    ),
    (
        r"^(?:libgpiod\w*|pigpio\w*|libpigpio\w*|libpigpiod\w*|python3?-(?:rpi\.gpio|gpiozero|pigpio\w*|libgpiod|lgpio)\w*|wiringpi|rpi\.gpio|jetson-gpio\w*)(?:-pip)?$",
        "gpio",
        0.8,
    ),
    (
        r"^(?:libusb-?\w*[\w.-]*|libhidapi\w*[\w-]*|hidapi|python3?-(?:usb|hid\w*|evdev|pyudev)|libphidget\w*|libuvc(?:-dev)?|libftdi\w*[\w-]*)$",
        "usb",
        0.75,
    ),
    (r"^(?:librealsense2|k4a|libopenni\w*[\w-]*|libfreenect\w*)$", "usb+camera", 0.8),
    (r"^(?:libcamera|libdc1394\w*[\w-]*|libraspberrypi\w*[\w-]*|v4l-utils|libv4l-dev|libmmal\w*)$", "camera", 0.7),
    (
        r"^(?:isaac_ros_(?:managed_)?nitros\w*|nvidia-cuda\w*[\w-]*|tensorrt\w*|libnvinfer\w*[\w-]*|cuda\w*[\w-]*|python3?-(?:torch|pytorch|tensorrt|cupy|pycuda|ultralytics)\w*[\w-]*|ultralytics\w*|torch\w*|onnxruntime[\w-]*gpu\w*|opencl\w*[\w-]*|ocl-icd\w*[\w-]*)$",
        "gpu",
        0.8,
    ),
)
BUILD = _signs(
    (
        r"^(?:find_package|language|component) (?:CUDA\w*|TensorRT|TENSORRT|HIP|OpenCL|vpi|VPI|cuDNN|CUDNN|Torch|CUVSLAM|cuvslam)$",
        "gpu",
        0.85,
    ),
    (
        r"^link (?:cuda\w*|cudart\w*|nvinfer\w*|cublas\w*|vpi|jetson-(?:inference|utils))$|^find_package jetson-(?:inference|utils)$",
        "gpu",
        0.85,
        "nvidia",
    ),
    (
        r"^(?:pkg_check_modules|pkg_search_module|link|find_library|find_package) (?:lib)?usb-?1?[\w.]*$|^(?:pkg_check_modules|link|find_library) (?:hidapi\w*|libudev)$",
        "usb",
        0.6,
    ),
    (
        r"^link (?:pigpio\w*|pigpiod_if\d?|wiringPi|gpiod\w*|bcm2835)$|^(?:pkg_check_modules|find_library|find_package) (?:lib)?(?:pigpio\w*|gpiod\w*|wiringPi)$",
        "gpio",
        0.85,
    ),
    (r"^(?:find_package|link) (?:realsense2?|k4a|ZED|Spinnaker\w*|SPINNAKER)$", "usb+camera", 0.8),
    (r"^(?:pkg_check_modules|find_library|link) (?:mmal\w*|libcamera\w*|v4l2|libv4l2|bcm_host)$", "camera", 0.75),
    (
        r"^(?:find_library|link|find_package|pkg_check_modules) (?:canlib|kvaser\w*|KVASER\w*|lely\w*|liblely\w*|socketcan\w*)$",
        "can",
        0.8,
    ),
    (r"^(?:find_package|link) (?:serial|LibSerial|libserialport|dynamixel_sdk)$", "serial", 0.6),
)
DEVICES = _signs(
    (r"^/dev/(?:tty(?:USB|ACM|AMA|THS|S|O|mxc|UL|XRUSB)|serial/)", "serial", 0.85),
    (r"^/dev/tty[\w.-]+", "serial", 0.5),
    (r"^/dev/(?:video|v4l)", "camera", 0.75, "", "v4l2"),
    (r"^/dev/(?:input/(?:js|event|by)|hidraw|bus/usb|js)", "usb", 0.7),
    (r"^/dev/(?:input/|spacenav)", "usb", 0.6),
    (r"^/dev/gpio|^/sys/(?:class|devices)/gpio", "gpio", 0.85),
    (r"^can\d+$", "can", 0.7, "", "socketcan"),
    (r"^s?lcan\d+$|^vcan\d+$", "can", 0.55),
    (r"^/dev/(?:nvidia|nvhost|dri/render)", "gpu", 0.6),
    (r"^cuda(?::\d+)?$", "gpu", 0.65, "nvidia"),
    (r"CUDAExecutionProvider|TensorrtExecutionProvider", "gpu", 0.7, "nvidia"),
    (r"nvarguscamerasrc|^csi://", "camera", 0.7, "csi"),
    (r"^/dev/\w*cam(?:era)?(?:[_\d]\w*)?$", "camera", 0.7, "", "v4l2"),
    (r"^/dev/(?:joy|gamepad)\w*$", "usb", 0.7, "joystick", "hid"),
    (
        r"^/dev/(?:\w+_)?(?:imu|ahrs|gps|gnss|rtk|lidar|laser|\w+lidar|hokuyo|sonar|arduino|mega|teensy|nano|stm\d*|esp\d*|mcu|board|motors?|wheels?|base|chassis|servos?|dynamixel|u2d2|roboclaw|vesc|pixhawk|fcu|autopilot|comm?|serial|uart|rs485|rs232|battery|bms|radio|xbee|encoders?|arm|gripper|controller)(?:_\w+|\d+)?$",
        "serial",
        0.75,
    ),
    (
        r"^/dev/(?!null|shm|random|urandom|tty$|std|i2c|spi|mem|fd|zero|rtc|watchdog|cpu|loop|snd|mqueue|vhci|input|gpio|video|v4l|js|hidraw|bus|nv|dri|serial|tty)[a-z][\w-]*$",
        "serial",
        0.35,
    ),
)
UDEV = _signs(
    (r"^tty$", "serial", 0.4),
    (r"^video4linux$", "camera", 0.4),
    (r"^(?:usb|input|hidraw)$", "usb", 0.25),
    (r"^(?:10c4|0403|067b|1a86|2341|2a03|16c0|0483|1546):", "serial", 0.45),
    (r"^(?:8086|03e7|2b03|045e|1e10|2bc5|05a9):", "usb+camera", 0.4),
    (r"^06c2:", "usb", 0.6, "phidget"),
)
"""By subsystem, and by the vendor of a USB-serial chip, a microcontroller or a camera (the USB vendor list)."""
NAMES = _signs(
    (r"(?:^|_)(?:usb|uvc)(?:_|$)", "usb", 0.6),
    (r"(?:^|_)(?:serial|uart|rs232|rs485)(?:_|$)", "serial", 0.5),
    (r"(?:^|_)(?:gpio)(?:_|$)", "gpio", 0.6),
    (r"(?:^|_)(?:socketcan|canbus)(?:_|$)", "can", 0.6),
    (r"(?:^|_)(?:cuda|tensorrt|trt)(?:_|$)", "gpu", 0.6, "nvidia"),
)
"""Interfaces in a package's own name."""
