"""The DRA driver devices.robotics.io: publishes the node's devices as ResourceSlices and hands allocated ones to containers."""
