"""What to install where the engine cannot be loaded."""

import re

REQUIRED = ("gymnasium", "numpy", "pettingzoo")
PACKAGES = {  # Debian's, by the beginning of a library's name; {} is the version behind it
    "libopencv_core.so.": "libopencv-core{}",
    "libopencv_imgproc.so.": "libopencv-imgproc{}",
    "libpng16.so.": "libpng16-{}",
    "libxxhash.so.": "libxxhash{}",
    "libz.so.": "zlib1g",
    "libtomlplusplus.so.": "libtomlplusplus{}",
    "libspdlog.so.": "libspdlog{}",
    "libfmt.so.": "libfmt{}",
}


def package_of(library: str) -> str | None:
    """The package that brings a library; None for one that is not known."""
    for begin, package in PACKAGES.items():
        if library.startswith(begin):
            return package.format(library.removeprefix(begin))
    return None


def explained(failure: ImportError) -> ImportError:
    """The same failure with what to do about it; itself where that is not known."""
    if isinstance(failure, ModuleNotFoundError) and failure.name == f"{__package__}._engine":
        return ImportError("comrad's engine is not compiled for this Python; run `pip install .` in COMRAD's folder")
    if isinstance(failure, ModuleNotFoundError) and failure.name in REQUIRED:
        return ImportError(f"comrad needs the package {failure.name}; run: pip install {failure.name}")
    missing = re.match(r"(lib\S+): cannot open shared object file", str(failure))
    package = package_of(missing[1]) if missing else None
    if missing is None or package is None:
        return failure
    return ImportError(
        f"comrad's engine needs {missing[1]}, which this machine lacks; on the Debian release it was compiled on: apt-get install "
        f"{package}; elsewhere install a package with that library, or compile comrad again with `pip install .` for the version that "
        "is there"
    )
