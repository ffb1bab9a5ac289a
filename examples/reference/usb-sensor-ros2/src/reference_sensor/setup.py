from setuptools import setup

NAME = "reference_sensor"

setup(
    name=NAME,
    version="1.0.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/sensor.launch.py"]),
        (f"share/{NAME}/config", ["config/sensor.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "driver = reference_sensor.driver_node:main",
            "listener = reference_sensor.listener_node:main",
        ]
    },
)
