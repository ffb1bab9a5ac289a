from setuptools import setup

NAME = "reference_navigation"

setup(
    name=NAME,
    version="1.0.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/navigation.launch.py"]),
        (f"share/{NAME}/config", ["config/navigation.yaml", "config/world.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "planner = reference_navigation.planner_node:main",
            "robot = reference_navigation.robot_node:main",
        ]
    },
)
