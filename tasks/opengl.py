"""Choice of the OpenGL backend for MuJoCo and dm_control, so that worlds also step on machines without OpenGL.

This module imports neither of the two packages.
"""

import ctypes
import os
import sys

_NEED_NO_LIBRARY = ("glfw", "on", "enable", "enabled", "true", "1", "off", "disable", "disabled", "false", "0")
"""Values of MUJOCO_GL with which both packages can be imported on any machine."""
_wish = ""
"""The value of MUJOCO_GL before `choose`."""


def choose() -> None:
    """Sets the environment variable MUJOCO_GL to a backend that can be loaded, on Linux only.

    MuJoCo and dm_control read it when they are imported, and their import fails if a library is missing. Without a
    screen and without a value set by the user it becomes "egl" or, if EGL is missing, "osmesa". If neither can be
    loaded, or the backend that the user set cannot, it becomes "disabled". Worlds then step, and rendering raises an
    error with the text of `no_opengl`.
    """
    global _wish
    _wish = os.environ.get("MUJOCO_GL", "").strip().lower()
    if sys.platform != "linux" or (not _wish and os.environ.get("DISPLAY")):
        return
    names = [_wish] if _wish else ["egl", "osmesa"]
    os.environ["MUJOCO_GL"] = next((name for name in names if name in _NEED_NO_LIBRARY or _loads(name)), "disabled")


def no_opengl() -> str:
    """One line that says why rendering fails and what to install."""
    settings = {"MUJOCO_GL": _wish, "PYOPENGL_PLATFORM": os.environ.get("PYOPENGL_PLATFORM")}
    with_what = " and ".join(f"{name}={value}" for name, value in settings.items() if value)
    return (
        f"pictures need OpenGL, and none works here{with_what and ' with ' + with_what}: without a screen install "
        "libegl1 (MUJOCO_GL=egl) or libosmesa6 (MUJOCO_GL=osmesa)"
    )


def _loads(name: str) -> bool:
    if os.environ.get("PYOPENGL_PLATFORM") not in (None, "", name):
        return False  # both packages raise an error
    try:
        if name == "egl":
            return _egl_devices() > 0
        return name == "osmesa" and any(_exists(f"libOSMesa.so{suffix}") for suffix in (".8", ".6", ""))
    except (OSError, ValueError):
        return False


def _exists(library: str) -> bool:
    try:
        return bool(ctypes.CDLL(library))
    except OSError:
        return False


def _egl_devices() -> int:
    """Number of devices on which EGL can render without a screen.

    Raises OSError without EGL, ValueError if EGL cannot list its devices.
    """
    address = ctypes.CDLL("libEGL.so.1").eglGetProcAddress
    address.restype, address.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    kind = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int))
    query, count = address(b"eglQueryDevicesEXT"), ctypes.c_int(0)
    if not query:
        raise ValueError("EGL cannot list devices")
    kind(query)(0, None, count)
    return count.value
