"""What is known of ROS and of device libraries, as tables: pure data, no name of a package that is being judged."""
