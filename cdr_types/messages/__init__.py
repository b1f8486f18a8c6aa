"""The ROS 2 messages that cross the wire, one module per ROS package, as mutable pycdr2 dataclasses.

Field names, order and types are those of the ROS 2 Humble interfaces; every field has the default of a fresh ROS
message (zeros, empty, and the identity quaternion). Nothing is checked on construction: `cdr_types.encode` checks.

The modules do not use `from __future__ import annotations`: pycdr2 reads the annotations themselves and cannot
resolve a dotted name that stands in a string.
"""

from __future__ import annotations

from cdr_types.messages import builtin_interfaces, geometry_msgs, sensor_msgs, std_msgs

__all__ = ["builtin_interfaces", "geometry_msgs", "sensor_msgs", "std_msgs"]
