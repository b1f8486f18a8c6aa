"""A window for pictures, with what is there: Tk, which is part of Python, or OpenCV. Where there is none, the reason.

Tk comes first since it only raises an error where a display cannot be reached; OpenCV's window may end the process.
"""

from __future__ import annotations

import os
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

__all__ = ["Window", "open_window"]

Picture = npt.NDArray[np.uint8]
QUIT_KEYS = ("q", "Q", "\x1b")


class Window(Protocol):
    """Shows pictures until a person closes it."""

    def show(self, picture: Picture) -> bool:
        """Show a picture, RGB; return whether the window is still wanted."""

    def close(self) -> None:
        """Close it; it can be closed already."""


def open_window(title: str) -> Window | str:
    """Return a window, or why there is none."""
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return "there is no display here (neither DISPLAY nor WAYLAND_DISPLAY is set)"
    reasons = []
    for make in (_TkWindow, _CvWindow):
        try:
            return make(title)
        except _NoWindow as reason:
            reasons.append(str(reason))
    return "; ".join(reasons)


class _NoWindow(Exception):
    """Why a window cannot be made."""


class _TkWindow:
    def __init__(self, title: str) -> None:
        try:
            import tkinter
        except ImportError:
            raise _NoWindow("Tk is not installed (apt install python3-tk)") from None
        self._error = tkinter.TclError
        self._photo = tkinter.PhotoImage
        try:
            self._root = tkinter.Tk()
        except tkinter.TclError as error:
            raise _NoWindow(f"Tk cannot open a window: {error}") from None
        self._root.title(title)
        self._label = tkinter.Label(self._root, borderwidth=0)
        self._label.pack()
        self._shown: Any = None
        self._is_wanted = True
        self._root.bind("<Key>", self._on_key)
        self._root.protocol("WM_DELETE_WINDOW", self._on_delete)

    def show(self, picture: Picture) -> bool:
        height, width = picture.shape[:2]
        try:
            # Tk keeps no reference of its own to what it shows.
            data = b"P6 %d %d 255\n" % (width, height) + picture.tobytes()
            self._shown = self._photo(master=self._root, data=data, format="PPM")
            self._label.configure(image=self._shown)
            self._root.update()
        except self._error:  # the display has gone
            return False
        return self._is_wanted

    def close(self) -> None:
        try:
            self._root.destroy()
        except self._error:
            return

    def _on_key(self, event: Any) -> None:  # noqa: ANN401  Tk's events are generic
        if event.char in QUIT_KEYS:
            self._is_wanted = False

    def _on_delete(self) -> None:
        self._is_wanted = False


class _CvWindow:
    def __init__(self, title: str) -> None:
        try:
            import cv2
        except ImportError:
            raise _NoWindow("OpenCV is not installed (pip install opencv-python)") from None
        self._cv2, self._title = cv2, title
        try:
            cv2.namedWindow(title, cv2.WINDOW_AUTOSIZE)
        except cv2.error:
            raise _NoWindow("OpenCV was built without windows (opencv-python-headless)") from None

    def show(self, picture: Picture) -> bool:
        cv2 = self._cv2
        cv2.imshow(self._title, np.ascontiguousarray(picture[:, :, ::-1]))
        key = cv2.waitKey(1)
        is_open = cv2.getWindowProperty(self._title, cv2.WND_PROP_VISIBLE) >= 1
        return bool(is_open and (key < 0 or chr(key & 0xFF) not in QUIT_KEYS))

    def close(self) -> None:
        self._cv2.destroyAllWindows()
