"""Bags, videos, folders of images, files of parameters and messages as CDR bytes; without ROS processes."""
