from setuptools import setup

NAME = "reference_detection"

setup(
    name=NAME,
    version="1.0.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/detection.launch.py"]),
        (f"share/{NAME}/config", ["config/detection.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "camera = reference_detection.camera_node:main",
            "detector = reference_detection.detector_node:main",
        ]
    },
)
