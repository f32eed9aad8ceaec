"""Packaging for pip (ROS 2 from wheels) and for colcon (ROS 2 from apt)."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "stab_ros"
SHARE = f"share/{NAME}"
ON_ROS_WHEELS = 'sys_platform == "linux" and platform_machine == "x86_64"'  # elsewhere ROS 2 comes from apt


def files_in(folder: str) -> tuple[str, list[str]]:
    """A `data_files` entry that installs the files of `folder` under the package's share directory."""
    return f"{SHARE}/{folder}", sorted(str(path) for path in Path(folder).glob("*") if path.is_file())


setup(
    name=NAME,
    version="0.1.0",
    description="Image stabilisation for river measurement from drones, live in ROS 2 and from recordings",
    license="Apache-2.0",
    maintainer="stab_ros maintainers",
    maintainer_email="maintainers@users.noreply.h-seed-60a7f06e.example",
    url="https://index.ros.org/p/stab_ros/",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "report/*.html", "report/*.css", "report/*.js", "nodes/*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (SHARE, ["package.xml"]),
        files_in("launch"),
        files_in("config"),
        files_in("config/cameras"),
        files_in("config/sros2"),
        files_in("config/systemd"),
        files_in("bags"),
    ],
    # Of Ubuntu 22.04 up: rclpy of Jazzy and of Kilted have wheels for it. Humble's rclpy lacks what the nodes need,
    # see docs/ros.md.
    python_requires=">=3.10",
    # Under apt's Jazzy these come from apt (see package.xml), where cv2 is the distribution "opencv" of python3-opencv.
    install_requires=[
        "numpy>=1.26",
        "opencv-contrib-python-headless>=4.6",
        "numba>=0.58",
        "apsw>=3.45",
        "av>=12.0",
        'backports.zstd>=1.0; python_version < "3.14"',
        "lz4>=4.0",
        "Jinja2>=3.0",
        "MarkupSafe>=2.0",
        "matplotlib>=3.6",
        "pillow>=9.4",
        "mcap>=1.3",
        "pyproj>=3.6",
        "rosbags>=0.11",
        "ruamel.yaml>=0.17",
        "rosbags-image>=0.10.4",
        "PyYAML>=6.0",
        "scipy>=1.11",
        "tifffile>=2023.7",
        "tqdm>=4.64",
        "zstandard>=0.22",
        f"ros-jazzy-rclpy[fastrtps]>=7.1.5; {ON_ROS_WHEELS}",
        f"ros-jazzy-common-interfaces>=5.3.6; {ON_ROS_WHEELS}",
    ],
    extras_require={
        "test": [
            "catkin-pkg>=1.0",
            "docutils>=0.18",
            "grimp>=3.20",
            "hypothesis>=6.98",
            "import-linter>=2.17",
            "mypy>=1.15",
            "pre-commit>=4.0",
            "pytest>=7.4",
            "pytest-xdist>=3.5",
            "rasterio>=1.3",
            "ruff>=0.9",
            "scipy-stubs>=1.14",
            "types-PyYAML>=6.0",
            "types-tqdm>=4.66",
        ],
        "docs": ["latex2mathml>=3.77", "mkdocs>=1.6,<2", "mkdocs-material>=9.5"],
    },
    entry_points={
        "console_scripts": [
            "stab-ros = stab_ros.cli:main",
            "tracker_node = stab_ros.nodes.tracker:main",
            "evaluator_node = stab_ros.nodes.evaluator:main",
            "georeference_node = stab_ros.nodes.georeference:main",
            "velocimetry_node = stab_ros.nodes.velocimetry:main",
            "discharge_node = stab_ros.nodes.discharge:main",
            "pipeline_node = stab_ros.nodes.pipeline:main",
            "bag_player_node = stab_ros.nodes.bag_player:main",
            "bag_recorder_node = stab_ros.nodes.bag_recorder:main",
        ],
    },
    zip_safe=True,
)
