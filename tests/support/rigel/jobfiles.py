"""Rigelfiles with jobs (Rigel 0.3 and newer) for the bridge's tests."""

G3 = """\
vars: {distro: humble, image: "acme/detector:2.1.0", gpu: 1, quick: true}
application: {distro: "{{ vars.distro }}"}
jobs:
  dockerfile:
    plugin: rigel.plugins.core.DockerfilePlugin
    with:
      compiler: {name: colcon}
      command: ros2 launch detector detect.launch.py
      env: [{name: LEVEL, value: 1}, {name: RMW_IMPLEMENTATION, value: rmw_cyclonedds_cpp}]
  build:
    plugin: rigel.plugins.core.BuildXPlugin
    with: {image: "{{ vars.image }}", push: true}
  deploy:
    plugin: rigel_bridge.RobotAppPlugin
    with:
      orchestration:
        name: detector
        scheduler: {policies: {qos_class: sensor_data}}
sequences:
  demo: {stages: [{jobs: [dockerfile, build, {name: deploy, with: {scheduler_name: kubernetes-scheduler}}]}]}
  benchmark_default: {stages: [{jobs: [{name: deploy, with: {scheduler_name: default-scheduler}}]}]}
  arguments: {stages: [{jobs: [{name: build, with: {buildargs: {scheduler_name: lab}}}, deploy]}]}
  without: {stages: [{jobs: [build]}]}
  sweep: {stages: [{matrix: {speed: [1, 2], name: [a]}, parallel: [{jobs: [deploy], dependencies: [build]}]}]}
"""


def with_block(block: str, text: str = G3) -> str:
    """The file with another orchestration block (flow style)."""
    head, _, rest = text.partition("      orchestration:\n")
    return f"{head}      orchestration: {block}\n{rest[rest.index('sequences:') :]}"
