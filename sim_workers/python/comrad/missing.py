"""What to do where the engine cannot be loaded."""

import platform
import re

REQUIRED = ("gymnasium", "nanobind_backend", "numpy", "pettingzoo")
COMPILE = "compile it there: `pip install .` in COMRAD's folder"
UNTESTED = f"{COMPILE} with --config-settings=cmake.define.COMRAD_UNTESTED_MACHINE=ON"


def what_this_machine_is() -> tuple[str, str, str]:
    """Its processor, the kind of its C library and that one's version, which are empty where it is not glibc."""
    return platform.machine(), *platform.libc_ver()


def explained(failure: ImportError) -> ImportError:
    """The same failure with what to do about it; itself where that is not known."""
    name = failure.name if isinstance(failure, ModuleNotFoundError) else None
    if name in REQUIRED:
        package = name.replace("_", "-")
        return ImportError(f"comrad needs the package {package}; run: pip install {package}")
    machine, library, version = what_this_machine_is()
    text = str(failure)
    if name == f"{__package__}._engine" or "_engine." in text or text.startswith("lib"):
        if machine != "x86_64":
            return ImportError(f"comrad's wheel is for x86-64 processors, this machine is {machine}; {UNTESTED}")
        if library != "glibc":
            return ImportError(f"comrad's wheel is for Linux with glibc, this system has another C library; {UNTESTED}")
    if name == f"{__package__}._engine":
        return ImportError("comrad's engine is not compiled for this Python; run `pip install .` in COMRAD's folder")
    if wanted := re.search(r"version `GLIBC_([\d.]+)' not found", text):
        return ImportError(f"comrad's engine needs glibc {wanted[1]} or newer, this system has {version}; {COMPILE}")
    if missing := re.match(r"(lib\S+): cannot open shared object file", text):
        return ImportError(f"comrad's engine needs {missing[1]}, which this machine lacks; install the package that has it, or {COMPILE}")
    return failure
