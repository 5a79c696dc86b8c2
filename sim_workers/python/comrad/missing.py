"""What to install where the engine cannot be loaded."""

import re

PACKAGES = {  # Debian 12, by the beginning of a library's name
    "libOSMesa.": "libosmesa6",
    "libopencv_core.": "libopencv-core406",
    "libopencv_imgproc.": "libopencv-imgproc406",
    "libpng16.": "libpng16-16",
    "libz.": "zlib1g",
    "libtomlplusplus.": "libtomlplusplus3",
    "libspdlog.": "libspdlog1.10",
    "libfmt.": "libfmt9",
}


def package_of(library: str) -> str | None:
    """The package that brings a library; None for one that is not known."""
    return next((package for begin, package in PACKAGES.items() if library.startswith(begin)), None)


def explained(failure: ImportError) -> ImportError:
    """The same failure with what to do about it; itself where that is not known."""
    if isinstance(failure, ModuleNotFoundError) and failure.name == f"{__package__}._engine":
        return ImportError("comrad's engine is not compiled for this Python; run `pip install .` in COMRAD's folder")
    missing = re.match(r"(lib\S+): cannot open shared object file", str(failure))
    package = package_of(missing[1]) if missing else None
    if missing is None or package is None:
        return failure
    return ImportError(
        f"comrad's engine needs {missing[1]}, which this machine lacks; on Debian 12: apt-get install {package}; elsewhere install "
        "a package with that library, or compile comrad again with `pip install .` for the version that is there"
    )
