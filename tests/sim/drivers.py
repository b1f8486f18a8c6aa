"""The message sequences of the manual's examples 6.1 to 6.7 as stand-in nodes, for virtual time and for the wire.

Each class is written from what its example publishes, when and how often, and from what ends it. A node is told what
arrived (`take`) and asked what its timers publish now (`tick`); it knows neither a clock nor a transport.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np
from pycdr2 import IdlStruct

from cdr_types.messages import geometry_msgs, sensor_msgs, std_msgs
from gateway.sim.robot.manual import EXAMPLE_HOME_RAD, MS, Fsm, S, Side

Out = list[tuple[str, IdlStruct]]

TARGET_61_M = (-0.014433992985935767, 0.0181230355198717, -0.545)
TARGET_61_XYZW = (-0.651863775688076, 0.260180077341881, 0.7053938323707012, 0.0989923560353721)
TARGET_64 = {Side.LEFT: (0.0, 1.57, 0.0, 0.26, 0.0, 0.0, 0.0), Side.RIGHT: (0.0, -1.57, 0.0, -0.26, 0.0, 0.0, 0.0)}


def as_pose(position: Iterable[float], quat_xyzw: Iterable[float]) -> geometry_msgs.Pose:
    """Return a pose message."""
    x, y, z = map(float, position)
    qx, qy, qz, qw = map(float, quat_xyzw)
    return geometry_msgs.Pose(
        position=geometry_msgs.Point(x=x, y=y, z=z), orientation=geometry_msgs.Quaternion(x=qx, y=qy, z=qz, w=qw)
    )


def joints(position: Iterable[float], names: Iterable[str] = ()) -> sensor_msgs.JointState:
    """Return a joint command with zero velocity and effort, as the examples send it."""
    values = [float(value) for value in position]
    zeros = [0.0] * len(values)
    return sensor_msgs.JointState(name=list(names), position=values, velocity=list(zeros), effort=list(zeros))


class Node:
    """Timers and the last message of each topic; `is_done` when the example would have ended."""

    def __init__(self) -> None:
        self.latest: dict[str, IdlStruct] = {}
        self.is_done = False
        self.sent = 0
        self._timers: list[list] = []
        self._now_ns = 0

    def every(self, period_ns: int, publish: Callable[[], Out]) -> None:
        """Add a timer."""
        self._timers.append([None, period_ns, publish])

    def take(self, topic: str, message: IdlStruct) -> Out:
        """Take a message that arrived; return what the node publishes at once."""
        self.latest[topic] = message
        return []

    def tick(self, now_ns: int) -> Out:
        """Return what the due timers publish."""
        self._now_ns = now_ns
        out: Out = []
        for timer in self._timers:
            timer[0] = now_ns + timer[1] if timer[0] is None else timer[0]
            while timer[0] <= now_ns and not self.is_done:
                timer[0] += timer[1]
                out += timer[2]()
        self.sent += len(out)
        return out

    def heartbeat(self) -> Out:
        """Publish 1.0."""
        return [("/api/fsm/enable", std_msgs.Float32(data=1.0))]

    def last_words(self) -> Out:
        """Return what the example publishes while it is being destroyed."""
        return [("/api/fsm/enable", std_msgs.Float32(data=0.0))]


class MoveToPose(Node):
    """§6.1: wait for READY, send a straight path at 50 Hz once, then only the heartbeat until the pose is reached.

    Args:
        looks: Whether it looks for its arrival; without, it goes on with the heartbeat.
    """

    def __init__(self, *, looks: bool = True) -> None:
        super().__init__()
        self._looks = looks
        self._path: list[geometry_msgs.Pose] = []
        self._index = 0
        self.error_m = math.inf
        self.every(50 * MS, self.heartbeat)
        self.every(20 * MS, self._next_point)

    def take(self, topic: str, message: IdlStruct) -> Out:
        super().take(topic, message)
        if topic != "/left_arm/current_ee_pose" or self.is_done:
            return []
        position = np.array([message.position.x, message.position.y, message.position.z])
        o = message.orientation
        quat = np.array([o.x, o.y, o.z, o.w]) / np.linalg.norm([o.x, o.y, o.z, o.w])
        if not self._path:
            self._plan(position, quat)
        self.error_m = float(np.linalg.norm(position - TARGET_61_M))
        alignment = abs(float(quat @ np.array(TARGET_61_XYZW) / np.linalg.norm(TARGET_61_XYZW)))
        if self._looks and self.error_m < 0.005 and alignment > 0.99:
            self.is_done = True
            return self.last_words()
        return []

    def _plan(self, begin_m: np.ndarray, begin: np.ndarray) -> None:
        end = np.array(TARGET_61_XYZW) / np.linalg.norm(TARGET_61_XYZW)
        end = end if begin @ end >= 0.0 else -end
        angle = math.acos(min(1.0, float(begin @ end)))
        way = np.array(TARGET_61_M) - begin_m
        steps = max(int(np.linalg.norm(way) / 0.01), 20)
        for step in range(steps + 1):
            part = step / steps
            weights = (1.0 - part, part)
            if angle > 1e-6:
                weights = (math.sin((1 - part) * angle) / math.sin(angle), math.sin(part * angle) / math.sin(angle))
            self._path.append(as_pose(begin_m + way * part, weights[0] * begin + weights[1] * end))

    def _next_point(self) -> Out:
        fsm = self.latest.get("/fsm_state")
        if fsm is None or fsm.data != Fsm.READY or self._index >= len(self._path):
            return []
        self._index += 1
        return [("/api/left_arm/target_pose", self._path[self._index - 1])]

    @property
    def has_sent_all(self) -> bool:
        """Whether the last point of the path is out."""
        return bool(self._path) and self._index == len(self._path)


class GripInJointMode(Node):
    """§6.2: echo the measured joints of both arms and send 0.04 to both grippers.

    Args:
        period_ns: Of the echo [ns]; the example's is 20 ms.
    """

    def __init__(self, period_ns: int = 20 * MS) -> None:
        super().__init__()
        self.every(50 * MS, self.heartbeat)
        self.every(period_ns, self._echo)

    def _echo(self) -> Out:
        states = {side: self.latest.get(f"/{side.value}_arm/joint_states") for side in Side}
        if None in states.values():
            return []
        out: Out = [(f"/api/{side.value}_arm/joint_cmd", joints(s.position, s.name)) for side, s in states.items()]
        return out + [(f"/api/{side.value}_gripper/cmd", std_msgs.Float32(data=0.04)) for side in Side]

    def last_words(self) -> Out:
        return []


class GripInPoseMode(Node):
    """§6.3: latch the first pose of both arms, repeat it at 50 Hz and send 0.0 to both grippers."""

    def __init__(self) -> None:
        super().__init__()
        self._latched: dict[Side, geometry_msgs.Pose] = {}
        self.every(20 * MS, self._repeat)
        self.every(50 * MS, self.heartbeat)

    def take(self, topic: str, message: IdlStruct) -> Out:
        for side in Side:
            if topic == f"/{side.value}_arm/current_ee_pose":
                self._latched.setdefault(side, message)
        return super().take(topic, message)

    def _repeat(self) -> Out:
        if len(self._latched) < 2:
            return []
        out: Out = [(f"/api/{side.value}_arm/target_pose", pose) for side, pose in self._latched.items()]
        return out + [(f"/api/{side.value}_gripper/cmd", std_msgs.Float32(data=0.0)) for side in Side]


class FixedTargets(Node):
    """§6.4: send a fixed symmetric target to both arms at 50 Hz from the first state on."""

    def __init__(self) -> None:
        super().__init__()
        self.every(50 * MS, self.heartbeat)
        self.every(20 * MS, self._send)

    def _send(self) -> Out:
        out: Out = []
        for side in Side:
            state = self.latest.get(f"/{side.value}_arm/joint_states")
            if state is not None and len(state.position) == 7:
                out.append((f"/api/{side.value}_arm/joint_cmd", joints(TARGET_64[side], state.name)))
        return out

    def last_words(self) -> Out:
        return []


class DriveChassis(Node):
    """§6.5: 0.05 m/s forward at 10 Hz for two seconds, then zero twice."""

    def __init__(self) -> None:
        super().__init__()
        self.every(100 * MS, lambda: [self._velocity(0.05)])
        self.every(2 * S, self._stop)

    def _velocity(self, vx: float) -> tuple[str, IdlStruct]:
        return ("/api/chassis/velocity", std_msgs.Float32MultiArray(data=[vx, 0.0, 0.0]))

    def _stop(self) -> Out:
        self.is_done = True
        return [self._velocity(0.0)]

    def last_words(self) -> Out:
        return [self._velocity(0.0)]


class InitialPosition(Node):
    """§6.6: interpolate both arms in five seconds to the initial position at 100 Hz, done 0.5 s after convergence."""

    def __init__(self) -> None:
        super().__init__()
        self._begin: dict[Side, np.ndarray] = {}
        self._begin_ns: int | None = None
        self._converged_ns: int | None = None
        self.every(50 * MS, self.heartbeat)
        self.every(10 * MS, self._interpolate)

    def _interpolate(self) -> Out:
        states = {side: self.latest.get(f"/{side.value}_arm/joint_states") for side in Side}
        if None in states.values():
            return []
        if self._begin_ns is None:
            self._begin_ns = self._now_ns
            self._begin = {side: np.array(state.position) for side, state in states.items()}
        part = min((self._now_ns - self._begin_ns) / (5 * S), 1.0)
        errors, out = [], []
        for side, state in states.items():
            target = np.array(EXAMPLE_HOME_RAD[side])
            command = self._begin[side] * (1.0 - part) + target * part
            out.append((f"/api/{side.value}_arm/joint_cmd", joints(command, state.name)))
            errors.append(float(np.max(np.abs(np.array(state.position) - target))))
        if part < 1.0:
            return out
        if max(errors) >= 0.05:
            self._converged_ns = None
        elif self._converged_ns is None:
            self._converged_ns = self._now_ns
        elif self._now_ns - self._converged_ns >= S // 2:
            self.is_done = True
        return out


class LiftDemo(Node):
    """§6.7: up for 1.5 s, stop for 0.4 s, down for 1.5 s at 20 Hz, then stop and disable twice."""

    def __init__(self) -> None:
        super().__init__()
        self._begin_ns: int | None = None
        self.every(50 * MS, self._send)

    def _send(self) -> Out:
        self._begin_ns = self._now_ns if self._begin_ns is None else self._begin_ns
        elapsed_s = (self._now_ns - self._begin_ns) / S
        if elapsed_s >= 3.4:
            self.is_done = True
            return self.last_words()
        velocity = 0.3 if elapsed_s < 1.5 else 0.0 if elapsed_s < 1.9 else -0.3
        return [("/api/servo/cmd", std_msgs.Float32MultiArray(data=[velocity, 1.0]))]

    def last_words(self) -> Out:
        return [("/api/servo/cmd", std_msgs.Float32MultiArray(data=[0.0, 0.0]))]
