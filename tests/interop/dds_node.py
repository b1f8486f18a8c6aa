"""A node of ROS 2 Humble's shape on a DDS graph of this computer: CycloneDDS, the names, QoS and announcement of rmw.

The graph is kept to the loopback interface and to those that have the same tag, so that many graphs live in one domain
side by side and no robot of the network is ever met. `loopback` gives the text for that; it must stand in the
environment (`CYCLONEDDS_URI`) before the first node of a process is made.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Final

from cyclonedds._clayer import ddspy_take
from cyclonedds.core import (
    DDSException,
    Entity,
    InstanceState,
    Policy,
    Qos,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from pycdr2 import IdlStruct as OurStruct

from gateway.sim.wire import Arrival
from tests.interop.dds_messages import DDS_TYPES, Gid, NodeEntitiesInfo, ParticipantEntitiesInfo, from_dds, to_dds

__all__ = ["ROBOT_DOMAIN", "BadPayload", "DdsNode", "loopback"]

ROBOT_DOMAIN: Final = 29
"""The robot's own DDS domain (§2.4)."""

_ANY: Final = ViewState.Any | InstanceState.Any | SampleState.Any
_XCDR1: Final = Policy.DataRepresentation(use_cdrv0_representation=True)
_RELIABLE: Final = Policy.Reliability.Reliable(duration(milliseconds=100))

DATA_QOS: Final = Qos(_RELIABLE, Policy.Durability.Volatile, Policy.History.KeepLast(10), _XCDR1)
"""Of all topics of the robot: reliable, volatile, the last ten (§4.1.1)."""

DISCOVERY_QOS: Final = Qos(_RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepLast(1), _XCDR1)
"""Of `ros_discovery_info`, as the middleware of Humble has it."""


def loopback(tag: str, lease_s: float = 10.0) -> str:
    """Return a configuration of CycloneDDS that keeps a graph to this computer and to those with the same tag.

    Args:
        tag: Any text; who has another one is not met, although in the same domain.
        lease_s: How long who does not say anything is thought to live [s]; the default of CycloneDDS.
    """
    return (
        "<CycloneDDS><Domain>"
        "<General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces>"
        "<AllowMulticast>false</AllowMulticast></General>"
        f"<Discovery><Tag>{tag}</Tag><LeaseDuration>{lease_s} s</LeaseDuration><ParticipantIndex>auto</ParticipantIndex>"
        "<MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>"
        "<Peers><Peer address='localhost'/></Peers></Discovery>"
        # Who ends does not wait a second per topic for readers that were killed.
        "<Internal><WriterLingerDuration>0 s</WriterLingerDuration></Internal>"
        "</Domain></CycloneDDS>"
    )


class BadPayload(ValueError):
    """Bytes that CycloneDDS cannot read as the type of their topic."""


class DdsNode:
    """A node with writers and readers, announced from the moment it is made.

    A thread of its own takes what arrives; everything else happens in the caller's thread.

    Attributes:
        arrivals: What has arrived, oldest first; the owner takes it out.
    """

    def __init__(
        self,
        name: str,
        *,
        publishes: Mapping[str, str],
        subscribes: Mapping[str, str],
        domain: int = ROBOT_DOMAIN,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Join the graph.

        Args:
            name: Name of the node.
            publishes: ROS topic -> ROS type of what it writes.
            subscribes: The same of what it reads.
            domain: DDS domain.
            clock: Gives the time of an arrival [ns].
        """
        self.arrivals: deque[Arrival] = deque()
        self._clock = clock
        # The middleware of ROS marks its participants with their enclave.
        self._participant = DomainParticipant(domain, qos=Qos(Policy.Userdata(b"enclave=/;")))
        self._readers = {
            topic: DataReader(self._participant, self._topic(topic, kind), qos=DATA_QOS)
            for topic, kind in subscribes.items()
        }
        self._writers = {
            topic: DataWriter(self._participant, self._topic(topic, kind), qos=DATA_QOS)
            for topic, kind in publishes.items()
        }
        discovery = Topic(self._participant, "ros_discovery_info", ParticipantEntitiesInfo)
        self._announcer = DataWriter(self._participant, discovery, qos=DISCOVERY_QOS)
        self._announcer.write(self._entities(name))
        self._is_open = True
        self._taker = threading.Thread(target=self._take_all, name=f"dds {name}", daemon=True)
        self._taker.start()

    def _topic(self, topic: str, kind: str) -> Topic:
        return Topic(self._participant, f"rt{topic}", DDS_TYPES[kind])

    def _entities(self, name: str) -> ParticipantEntitiesInfo:
        node = NodeEntitiesInfo(
            node_namespace="/",
            node_name=name,
            reader_gid_seq=[_gid(reader) for reader in self._readers.values()],
            writer_gid_seq=[_gid(writer) for writer in self._writers.values()],
        )
        return ParticipantEntitiesInfo(gid=_gid(self._participant), node_entities_info_seq=[node])

    def write(self, topic: str, message: OurStruct) -> None:
        """Publish a message; CycloneDDS serializes it.

        Args:
            topic: One of those it publishes.
            message: Of the topic's type.
        """
        self._writers[topic].write(to_dds(message))

    @staticmethod
    def read(type_name: str, payload: bytes) -> OurStruct:
        """Return the message of a sample; CycloneDDS decodes it.

        Args:
            type_name: ROS type.
            payload: Its bytes as they came out of DDS, with header and padding.

        Raises:
            BadPayload: If CycloneDDS cannot.
        """
        try:
            return from_dds(DDS_TYPES[type_name].deserialize(payload))
        except Exception as error:  # whatever its decoder meets in bytes of somebody else
            raise BadPayload(f"{type(error).__name__}: {error}") from error

    def close(self) -> None:
        """Leave the graph in good order; safe to call twice."""
        if self._is_open:
            self._is_open = False
            self._taker.join()
            self._participant._delete(self._participant._ref)  # and all that it has, now and not when it is collected

    def _take_all(self) -> None:
        """Take whatever arrives until the node is closed."""
        waiting = WaitSet(self._participant)
        conditions = [ReadCondition(reader, _ANY) for reader in self._readers.values()]
        for condition in conditions:
            waiting.attach(condition)
        while self._is_open:
            waiting.wait(duration(milliseconds=50))
            now_ns = self._clock()
            for topic, reader in self._readers.items():
                taken = ddspy_take(reader._ref, _ANY, 64)
                if isinstance(taken, int):
                    raise DDSException(taken, f"while taking from {topic}")
                self.arrivals.extend(Arrival(topic, now_ns, data) for data, info in taken if info.valid_data)


def _gid(entity: Entity) -> Gid:
    return Gid(data=[*entity.guid.bytes, *bytes(8)])
