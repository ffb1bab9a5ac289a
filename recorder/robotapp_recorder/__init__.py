"""The recorder of an app: topics into MCAP files on a volume, split, and bounded in size.

settings, topics, definitions and retention are pure; bags and store write files; node alone uses rclpy.
"""
