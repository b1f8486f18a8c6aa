"""Gateway between user code and a TeleAvatar 2 robot: no ROS, no bridge, one safe way in."""

__all__ = ["__version__"]

__version__ = "0.1.0"
