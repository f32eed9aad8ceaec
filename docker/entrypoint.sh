#!/bin/bash
# Runs a command with ROS and this package in the environment.
set -e
source /opt/stab_ros/install/setup.bash
exec "$@"
