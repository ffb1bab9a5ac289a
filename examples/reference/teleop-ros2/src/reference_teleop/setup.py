from setuptools import setup

NAME = "reference_teleop"

setup(
    name=NAME,
    version="1.0.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/teleop.launch.py"]),
        (f"share/{NAME}/config", ["config/teleop.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "operator = reference_teleop.operator_node:main",
            "robot = reference_teleop.robot_node:main",
        ]
    },
)
