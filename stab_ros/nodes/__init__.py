"""The ROS 2 nodes: a thin shell of rclpy around the core and io."""
