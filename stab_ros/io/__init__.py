"""Bags, videos, folders of images and messages as CDR bytes; knows the core, not ROS."""
