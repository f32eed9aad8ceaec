"""A package of messages made and compiled from its .msg files by rosidl's own generators, and installed into a prefix.

As colcon does it, for Python and Fast DDS alone: a shared library of each generator, and the extension module. The
command `rosidl` is not used: from wheels, it finds some of its parts twice, and others want catkin_pkg.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rosidl_generator_py
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_generator_type_description.cli import HashTypeDescription
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

# The prefix of ROS, which AMENT_PREFIX_PATH must name.
ROS = next(place for place in Path(rosidl_generator_py.__file__).parents if (place / "share/rosidl_cmake").is_dir())

_DISPATCHED = ["rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"]
_GENERATORS = {  # by what their library's name ends with, each after those that it needs
    "rosidl_generator_c": GenerateC("c"),
    "rosidl_typesupport_fastrtps_c": GenerateFastRTPSCTypesupport("fastrtps_c"),
    "rosidl_typesupport_introspection_c": GenerateIntrospectionCTypesupport("introspection_c"),
    "rosidl_typesupport_c": GenerateCTypesupport("c", typesupport_implementations=_DISPATCHED),
}
_PYTHON = GeneratePython("py", typesupport_implementations=["rosidl_typesupport_c"])
_LIBRARIES = [
    "rosidl_runtime_c", "rcutils", "rmw", "fastcdr", *_DISPATCHED, "rosidl_typesupport_c",
    "rosidl_typesupport_fastrtps_cpp",
    "stdc++",
]


def compiler() -> str | None:
    """One of C and C++ beside the headers of this Python; None: something of it is missing."""
    headers = Path(sysconfig.get_path("include"), "Python.h")
    return shutil.which("gcc") if headers.is_file() and shutil.which("g++") else None


def install_messages(prefix: Path, package: str, messages: Mapping[str, str], gcc: str,
                     uses: Sequence[str] = ()) -> dict[str, str]:
    """Makes what the package's users would build and source.

    messages: text of each .msg file by the name of its type. uses: the packages they may use beside builtin_interfaces.

    Returns:
        What sourcing it adds to the environment.
    """
    share, modules = prefix / "share" / package, prefix / "lib" / f"python{sys.version[:4]}" / "site-packages" / package
    _write_definitions(share, package, messages)
    _generate(share, package, [*messages], prefix / "build", modules)
    _compile(prefix, package, modules, gcc, ("builtin_interfaces", *uses))
    return {"PYTHONPATH": str(modules.parent), "LD_LIBRARY_PATH": str(prefix / "lib"), "AMENT_PREFIX_PATH": str(prefix)}


def sourced(environment: Mapping[str, str], added: Mapping[str, str]) -> dict[str, str]:
    """The environment with `added` in front of each path."""
    paths = {name: os.pathsep.join(filter(None, (path, environment.get(name)))) for name, path in added.items()}
    return {**environment, **paths}


def _write_definitions(share: Path, package: str, messages: Mapping[str, str]) -> None:
    (share / "msg").mkdir(parents=True)
    for name, text in messages.items():
        (share / "msg" / f"{name}.msg").write_text(text)
        convert_msg_to_idl(share, package, Path("msg", f"{name}.msg"), share / "msg")


def _generate(share: Path, package: str, names: list[str], build: Path, modules: Path) -> None:
    """build: for the C and C++ files, a folder for each generator. modules: for the Python package, and C."""
    files, used = [f"{share}:msg/{name}.idl" for name in names], [str(ROS / "share"), str(share.parent)]
    HashTypeDescription("hash").generate_type_hashes(package, files, used, share)
    for kind, generator in _GENERATORS.items():
        hashes = [str(share / "msg" / f"{name}.json") for name in names]
        described = {"type_description_files": hashes} if kind == "rosidl_generator_c" else {}
        generator.generate(package, files, used, build / kind / package, **described)
    _PYTHON.generate(package, files, used, modules)
    (modules / "__init__.py").touch()


def _compile(prefix: Path, package: str, modules: Path, gcc: str, uses: Sequence[str]) -> None:
    """The libraries of the generators, and of the rest the extension module that the messages' classes import."""
    own = [prefix / "build" / kind for kind in _GENERATORS]
    headers = [*own, ROS / "include", *(ROS / "include").iterdir(), sysconfig.get_path("include"), np.get_include()]
    module = modules / f"{package}_s__rosidl_typesupport_c{sysconfig.get_config_var('EXT_SUFFIX')}"
    outputs = {folder: prefix / "lib" / f"lib{package}__{folder.name}.so" for folder in own} | {modules: module}
    theirs = [*_LIBRARIES, *(f"{one}__{kind}" for one in uses for kind in (*_GENERATORS, "rosidl_generator_py"))]
    libraries: list[str] = []
    for folder, output in outputs.items():
        words = [gcc, "-O0", "-w", "-shared", "-fPIC", "-o", str(output), *(f"-I{place}" for place in headers)]
        words += [str(path) for suffix in ("c", "cpp") for path in folder.rglob(f"*.{suffix}")]
        words += [f"-L{prefix / 'lib'}", f"-L{ROS / 'lib'}", *(f"-l{name}" for name in (*libraries, *theirs))]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        libraries.append(output.stem.removeprefix("lib"))
