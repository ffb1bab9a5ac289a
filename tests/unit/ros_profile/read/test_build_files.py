"""CMake, plug-in descriptions, robot models, udev rules, definitions."""

from textwrap import dedent

import pytest

from ros_profile.model.facts import Kind
from ros_profile.model.package import SourceFile
from ros_profile.read.cmake import read_cmake
from ros_profile.read.interfaces import read_interface
from ros_profile.read.udev import read_udev
from ros_profile.read.xml_files import read_xml


def cmake(text: str) -> SourceFile:
    return read_cmake(dedent(text).encode(), "CMakeLists.txt")


def pairs(source: SourceFile) -> list[tuple[str, str, float]]:
    return [(fact.subject, fact.value, fact.weight) for fact in source.facts]


def test_executables_have_their_sources_with_variables_replaced() -> None:
    source = cmake("""
        project(demo LANGUAGES CXX)
        set(SRC src/a.cpp src/b.cpp)
        list(APPEND SRC src/c.cpp)  # a comment
        add_executable(${PROJECT_NAME}_node ${SRC})
    """)
    (executable,) = source.executables
    assert (executable.name, executable.files) == ("demo_node", ("src/a.cpp", "src/b.cpp", "src/c.cpp"))


def test_components_and_scripts_are_executables() -> None:
    source = cmake("""
        add_library(cam SHARED src/cam.cpp)
        rclcpp_components_register_node(cam PLUGIN "demo::Cam" EXECUTABLE cam_node)
        install(PROGRAMS scripts/run.py DESTINATION lib/demo)
    """)
    assert [(e.name, e.kind, e.plugin, e.files) for e in source.executables] == [
        ("cam_node", "component", "demo::Cam", ("src/cam.cpp",)),
        ("run.py", "script", "", ("scripts/run.py",)),
    ]


def test_a_language_and_packages_are_facts_and_optional_ones_weigh_less() -> None:
    source = cmake("""
        project(x LANGUAGES CXX CUDA)
        find_package(TensorRT REQUIRED)
        find_package(OpenCL QUIET)
        pkg_check_modules(USB REQUIRED libusb-1.0)
    """)
    assert pairs(source) == [
        ("language", "CUDA", 1.0),
        ("find_package", "TensorRT", 1.0),
        ("find_package", "OpenCL", 0.5),
        ("pkg_check_modules", "libusb-1.0", 1.0),
    ]


def test_what_only_tests_need_is_left_out() -> None:
    source = cmake(
        "if(BUILD_TESTING)\nfind_package(CUDA)\nadd_executable(t t.cpp)\nelse()\nfind_package(a)\nendif()\nfind_package(b)"
    )
    assert [value for _, value, _ in pairs(source)] == ["a", "b"]


def test_a_variable_that_doubles_stays_small() -> None:
    source = cmake("set(A x)\n" + "set(A ${A} ${A})\n" * 60 + "find_package(${A})")
    assert [value for _, value, _ in pairs(source)] == ["x"]


def test_plugin_descriptions_name_base_and_class() -> None:
    source = read_xml(
        b'<library path="x"><class type="d::C" base_class_type="nav2_core::Controller"/></library>', "p.xml"
    )
    assert [(f.kind, f.subject, f.value) for f in source.facts] == [(Kind.PLUGIN_BASE, "nav2_core::Controller", "d::C")]


def test_a_nodelet_is_a_component() -> None:
    source = read_xml(b'<library path="x"><class type="d::N" base_class_type="nodelet::Nodelet"/></library>', "p.xml")
    assert Kind.COMPONENT in {fact.kind for fact in source.facts}


def test_ros2_control_hardware_has_its_device() -> None:
    source = read_xml(
        b'<robot name="r"><ros2_control name="a" type="system"><hardware><plugin>d/Drive</plugin>'
        b'<param name="port">/dev/ttyACM0</param></hardware></ros2_control></robot>',
        "urdf/r.urdf.xacro",
    )
    assert [(f.kind, f.subject, f.value) for f in source.facts] == [
        (Kind.DEVICE_PATH, "/dev/ttyACM0", "port"),
        (Kind.HARDWARE_PLUGIN, "d/Drive", "/dev/ttyACM0"),
    ]


def test_a_document_type_is_refused() -> None:
    source = read_xml(b'<!DOCTYPE r [<!ENTITY a "b">]><library><class type="&a;"/></library>', "p.xml")
    assert (source.facts, len(source.problems)) == ((), 1)


def test_udev_rules_give_identity_and_subsystem() -> None:
    source = read_udev(
        b'# x\nKERNEL=="ttyUSB*", ATTRS{idVendor}=="10c4", ATTRS{idProduct}=="EA60", SYMLINK+="lidar"\n', "u.rules"
    )
    assert [(f.subject, f.value) for f in source.facts] == [("10c4:ea60", "lidar"), ("tty", "lidar")]


def test_definitions_are_named_and_their_parts_counted() -> None:
    good = read_interface(b"std_msgs/Header header  # h\nfloat64[3] v\n", "msg/Speed.msg")
    bad = read_interface(b"int32 a\n", "srv/Add.srv")
    assert [(f.subject, f.value) for f in good.facts] == [("msg/Speed", "std_msgs/Header")]
    assert "1 parts" in bad.problems[0].message


@pytest.mark.parametrize(
    "text",
    [
        "function(add_node name)\n  add_executable(${name} ${ARGN})\nendfunction()\nadd_node(lidar src/a.cpp)",
        'macro(add_node target src)\n  add_executable("${target}" "${src}")\nendmacro()\nADD_NODE(lidar src/a.cpp)',
        (
            "function(inner n)\n add_executable(${n} ${ARGV1})\nendfunction()\n"
            "function(outer n)\n inner(${n} src/a.cpp)\nendfunction()\nouter(lidar)"
        ),
        "foreach(n lidar)\n  add_executable(${n} src/a.cpp)\nendforeach()",
        "set(all lidar)\nforeach(n IN LISTS all)\n  add_executable(${n} src/a.cpp)\nendforeach()",
        "add_executable(node src/a.cpp)\nset_target_properties(node PROPERTIES OUTPUT_NAME lidar)",
        "add_executable(node src/a.cpp)\nset_target_properties(node PROPERTIES PREFIX x OUTPUT_NAME lidar)",
    ],
)
def test_programs_are_called_as_functions_loops_and_properties_make_them(text: str) -> None:
    found = read_cmake(f"project(p)\n{text}\n".encode(), "CMakeLists.txt").executables
    assert [(one.name, one.files) for one in found] == [("lidar", ("src/a.cpp",))]


def test_a_function_that_is_not_called_makes_nothing_and_one_that_calls_itself_ends() -> None:
    unused = "function(add_node name)\n  add_executable(${name} src/a.cpp)\nendfunction()\n"
    assert read_cmake(unused.encode(), "CMakeLists.txt").executables == ()
    endless = "function(f n)\n f(${n})\n f(${n})\n add_executable(a a.cpp)\nendfunction()\nf(x)\n" * 3
    assert len(read_cmake(endless.encode(), "CMakeLists.txt").executables) < 5000
    loops = "foreach(a 1 2 3 4 5 6 7 8 9)\n" * 9 + "add_executable(a a.cpp)\n" + "endforeach()\n" * 9
    assert len(read_cmake(loops.encode(), "CMakeLists.txt").executables) < 5000
