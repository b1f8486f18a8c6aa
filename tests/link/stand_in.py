"""A stand-in for the robot's router and bridge: a process of its own, so that tests can kill, freeze and restart it.

`python stand_in.py ENDPOINT [NAMESPACE]` listens, announces and publishes all state topics and takes all commands, as
zenoh-plugin-ros2dds does on the wire: tokens, admin space, CDR, and a reader per state topic that exists only since a
subscriber matched. It has no physics and no FSM. Commands come as JSON lines on stdin, each is answered by one line:

    {"do": "stats"}                      what arrived, by key; tokens of others; own zenoh id
    {"do": "clear"}                      forget what arrived
    {"do": "kill_route", "topic": ...}   the bridge loses its reader although a subscriber still matches
    {"do": "leave"} / {"do": "return"}   the robot's node goes away with its tokens / comes back
    {"do": "copies", "number": N}        every state N times
    {"do": "spoil", "topic": ...}        this topic carries NaN

"""

from __future__ import annotations

import json
import math
import sys
import threading
import time

import zenoh

from cdr_types import encode
from cdr_types.keys import Qos, Reliability, Token, TokenKind, format_token, topic_to_key
from cdr_types.messages import builtin_interfaces, geometry_msgs, sensor_msgs, std_msgs
from gateway.robot.topics import INT32, JOINT_STATE, POSE, STATE_TOPICS, TOPICS, Direction

PERIOD_S = 0.005
MODE = {
    "meta_mode": 1,
    "left_arm_control_mode": 1,
    "right_arm_control_mode": 1,
    "enable_left_arm": True,
    "enable_right_arm": True,
    "enable_chassis": True,
    "enable_lift_servo": False,
    "enable_collision_check": True,
}


def state_message(topic: str, stamp_ns: int, *, is_spoilt: bool = False):
    """Return a plausible message of a state topic."""
    row = TOPICS[topic]
    if row.type_name == JOINT_STATE:
        sec, nanosec = divmod(stamp_ns, 1_000_000_000)
        return sensor_msgs.JointState(
            header=std_msgs.Header(stamp=builtin_interfaces.Time(sec=sec, nanosec=nanosec), frame_id="part"),
            name=list(row.names),
            position=[math.nan if is_spoilt else 0.25] * row.width,
            velocity=[0.0] * row.width,
            effort=[0.5] * row.width,
        )
    if row.type_name == POSE:
        return geometry_msgs.Pose(
            position=geometry_msgs.Point(x=0.3, y=0.0, z=-0.2),
            orientation=geometry_msgs.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        )
    if row.type_name == INT32:
        return std_msgs.Int32(data=0)
    return std_msgs.String(data=json.dumps(MODE))


class Keepsake:
    """A sample that zenoh keeps; it is its own payload."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    @property
    def payload(self) -> Keepsake:
        return self

    def to_bytes(self) -> bytes:
        return self._data


class StandIn:
    """The session and what is declared on it."""

    def __init__(self, endpoint: str, namespace: str) -> None:
        config = {
            "mode": "router",
            "listen": {"endpoints": [endpoint]},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "adminspace": {"enabled": True},
        }
        self.session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        self.zid = str(self.session.zid())
        self.keys = {topic: topic_to_key(topic, namespace) for topic in TOPICS}
        self.received: dict[str, list[str]] = {}
        self.has_reader = dict.fromkeys(STATE_TOPICS, False)
        self.spoilt: set[str] = set()
        self.copies = 1
        self.is_present = True
        self.ending = threading.Event()
        self.publishers = {
            topic: self.session.declare_publisher(
                self.keys[topic],
                congestion_control=zenoh.CongestionControl.BLOCK,
                allowed_destination=zenoh.Locality.REMOTE,
            )
            for topic in STATE_TOPICS
        }
        self.kept = [
            publisher.declare_matching_listener(zenoh.handlers.Callback(self._matcher(topic), indirect=False))
            for topic, publisher in self.publishers.items()
        ]
        prefix = topic_to_key("/api", namespace)
        self.kept.append(
            self.session.declare_subscriber(
                f"{prefix}/**",
                zenoh.handlers.Callback(self._take, indirect=False),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        )
        self.kept.append(
            self.session.declare_queryable(
                f"@/{self.zid}/ros2/**", zenoh.handlers.Callback(self._answer, indirect=False)
            )
        )
        self.tokens = self._announce()

    def _matcher(self, topic):
        def changed(status) -> None:
            self.has_reader[topic] = bool(status.matching)

        return changed

    def _announce(self):
        kinds = {Direction.STATE: TokenKind.MP, Direction.COMMAND: TokenKind.MS}
        return [
            self.session.liveliness().declare_token(
                format_token(
                    Token(
                        zid=self.zid,
                        kind=kinds[row.direction],
                        topic=f"/{self.keys[topic]}",
                        type_name=row.type_name,
                        qos=Qos(reliability=Reliability.RELIABLE),
                    )
                )
            )
            for topic, row in TOPICS.items()
        ]

    def _take(self, sample) -> None:
        kind = "put" if sample.kind == zenoh.SampleKind.PUT else "delete"
        payload = sample.payload.to_bytes()
        lane = f"{sample.priority} {sample.congestion_control} {'express' if sample.express else 'batched'}"
        entry = f"{kind} {payload.hex() if len(payload) < 400 else 'long'} {lane}"
        self.received.setdefault(str(sample.key_expr), []).append(entry)

    def _answer(self, query) -> None:
        start = f"@/{self.zid}/ros2"
        answers = {f"{start}/version": "9.9.9"}
        for topic, row in TOPICS.items():
            key = self.keys[topic]
            if row.direction is Direction.STATE:
                reader = "0123" if self.has_reader[topic] else ""
                answers[f"{start}/route/topic/pub/{key}"] = {"dds_reader": reader, "remote_routes": []}
            else:
                answers[f"{start}/route/topic/sub/{key}"] = {"is_active": True}
        for key, fields in answers.items():
            if query.key_expr.intersects(zenoh.KeyExpr(key)):
                query.reply(key, json.dumps(fields))

    def publish(self) -> None:
        """Publish on the grid until the end."""
        tick, due_s = 0, time.monotonic()
        while not self.ending.is_set():
            stamp_ns = time.time_ns()
            for topic, row in TOPICS.items():
                every = max(1, round(1 / (row.rate_hz * PERIOD_S)))
                if row.direction is Direction.STATE and self.has_reader[topic] and tick % every == 0:
                    if not self.is_present:
                        continue
                    payload = encode(state_message(topic, stamp_ns, is_spoilt=topic in self.spoilt))
                    for _ in range(self.copies):
                        self.publishers[topic].put(payload)
            tick += 1
            due_s = max(due_s + PERIOD_S, time.monotonic() - 0.1)
            self.ending.wait(max(0.0, due_s - time.monotonic()))

    def obey(self, command) -> dict[str, object]:
        """Carry out one command; return its answer."""
        match command["do"]:
            case "stats":
                found = self.session.liveliness().get("@/*/@ros2_lv/MS/*/*/*", timeout=1.0)
                tokens = [str(reply.ok.key_expr) for reply in found if reply.ok is not None]
                foreign = sorted(token for token in tokens if f"@/{self.zid}/" not in token)
                return {"zid": self.zid, "received": self.received, "foreign_tokens": foreign}
            case "clear":
                self.received = {}
            case "kill_route":
                self.has_reader[command["topic"]] = False
            case "leave":
                self.is_present = False
                for token in self.tokens:
                    token.undeclare()
            case "return":
                self.is_present = True
                self.tokens = self._announce()
            case "copies":
                self.copies = command["number"]
            case "spoil":
                self.spoilt.add(command["topic"])
        return {"done": command["do"]}


def main() -> None:
    """Serve until stdin ends."""
    stand_in = StandIn(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "")
    publishing = threading.Thread(target=stand_in.publish)
    publishing.start()
    print(json.dumps({"zid": stand_in.zid}), flush=True)
    for line in sys.stdin:
        print(json.dumps(stand_in.obey(json.loads(line))), flush=True)
    stand_in.ending.set()
    publishing.join()
    stand_in.session.close()


if __name__ == "__main__":
    main()
