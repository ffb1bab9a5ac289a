from setuptools import setup

NAME = "reference_fleet"

setup(
    name=NAME,
    version="1.0.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/fleet.launch.py"]),
        (f"share/{NAME}/config", ["config/fleet.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "coordinator = reference_fleet.coordinator_node:main",
            "robot = reference_fleet.robot_node:main",
        ]
    },
)
