"""Imports Open3D late, with libusb supplied from PyPI, so that neither is needed by those who do not use it."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import sys
from types import ModuleType

from saphari_drake.errors import SensorError


@functools.cache
def import_open3d() -> ModuleType:
    """Return the module `open3d`.

    Open3D links to libusb-1.0. On Linux the library that `libusb-package` carries is loaded first, so that no system
    package is needed.

    Raises
    ------
    SensorError
        If Open3D cannot be imported; the message says what to install.
    """
    if sys.platform == "linux":
        # Without the package the system's libusb-1.0 serves; without either, the import below fails and says so.
        with contextlib.suppress(ImportError, OSError):
            import libusb_package

            ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise SensorError(
            f"the ray-casting camera needs Open3D, which cannot be imported ({error}); "
            "install 'open3d-cpu' (Linux x86-64) or 'open3d', and 'libusb-package' or Debian's 'libusb-1.0-0'"
        ) from error
    return open3d
