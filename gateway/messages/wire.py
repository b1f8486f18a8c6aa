"""The state of the wire as structs: routers, bridges, topics and who else is there. `gateway.link.survey` makes them.

Tolerant, as all that comes out: a later daemon may add fields. Import these names from
`gateway.api.protocol`.
"""

from __future__ import annotations

from msgspec import Struct

__all__ = ["Announcement", "Wire", "WireBridge", "WireNeighbour", "WireTopic"]


class Announcement(Struct, frozen=True, kw_only=True):
    """What a bridge says about a topic by a liveliness token.

    Attributes:
        zid: Zenoh id of the bridge.
        type_name: ROS type.
        qos: As in the token, `:1::0,10`; a field is empty where the node did not say it.
    """

    zid: str
    type_name: str
    qos: str


class WireTopic(Struct, frozen=True, kw_only=True):
    """One topic of the robot.

    Attributes:
        name: ROS name, without the namespace.
        key: Key on the wire, with it.
        is_state: Whether the robot publishes it; else it takes it.
        type_name: ROS type that the manual says.
        nominal_hz: The robot's rate (manual §4.1.1), for commands ours.
        announced: By whose bridges, and as what: publishers of a state, subscribers of a command.
        route: `active`, `silent` (announced, nothing comes), `dead` (the bridge does not read it), `lost` (nobody announces
            what came before), `inactive` (the bridge does not write it), `unannounced`, `announced` (a command of which the
            tokens tell and nothing else is known) or `unknown`.
        is_heard: Whether whoever looks subscribes to it; the rest is known of those only.
        rate_hz: Measured over the last seconds, copies excluded [Hz].
        times: How often each sample came: 1 on a healthy bridge.
        age_ns: Since the newest sample [ns]; null when none came over this transport.
        refused: Samples that could not be read.
        why_refused: What was wrong with the last of them.
    """

    name: str
    key: str
    is_state: bool
    type_name: str
    nominal_hz: float
    announced: tuple[Announcement, ...]
    route: str
    is_heard: bool
    rate_hz: float = 0.0
    times: float = 1.0
    age_ns: int | None = None
    refused: int = 0
    why_refused: str = ""


class WireBridge(Struct, frozen=True, kw_only=True):
    """A ROS bridge that announces itself.

    Attributes:
        zid: Zenoh id.
        is_robot: Whether it announces the robot's state topics.
        namespaces: Under which it announces a robot; one that is empty stands for none.
        version: As it says; empty when it does not.
        domain: DDS domain behind it; null when it does not say.
    """

    zid: str
    is_robot: bool
    namespaces: tuple[str, ...] = ()
    version: str = ""
    domain: int | None = None


class WireNeighbour(Struct, frozen=True, kw_only=True):
    """Somebody who is connected to the robot's router, or seen through it.

    Attributes:
        zid: Zenoh id; empty for a sender that does not name itself.
        kind: `self`, `guard` (of this gateway), `gateway`, `robot` (the robot's own bridge), `bridge` (a host's) or `session`.
        is_armed: Of a gateway, whether it commands the robot.
        whatami: `client`, `peer` or `router`, as the router has it; empty when it is not connected to it directly.
        address: Its end of the link; empty when unknown.
        publishes: Command topics that it announces to publish.
        listens: State topics that it announces to subscribe to.
        sent: Per command topic, samples of it that were seen since whoever looks began to look.
        sent_age_ns: Since the last of them [ns]; null when there were none.
    """

    zid: str
    kind: str
    is_armed: bool = False
    whatami: str = ""
    address: str = ""
    publishes: tuple[str, ...] = ()
    listens: tuple[str, ...] = ()
    sent: dict[str, int] = {}
    sent_age_ns: int | None = None


class Wire(Struct, frozen=True, kw_only=True):
    """Everything that one session knows of its wire to the robot.

    Attributes:
        endpoint: Of the robot's router.
        namespace: That is listened under; empty for none.
        model: `lite`, `standard` or `lift` (manual §1.2).
        zid: Own zenoh id; empty without a session.
        is_up: Whether there is a transport.
        up_ns: For how long [ns]; 0 without one.
        trouble: Why there is none, as far as it can be known; empty otherwise.
        router_zid: Zenoh id of the router; empty without a transport.
        router_version: Of zenoh there, as it says; empty when its admin space is closed.
        clock_ns: The robot's clock minus ours, from stamps of its samples [ns]: too small by what they need to get here;
            null before one came.
        robots: Namespaces under which robots announce themselves; an empty one for none.
        bridges: All that announce themselves, the robot's first.
        topics: Of this model, states first.
        neighbours: Who else is there; this session and the robot's bridge are among them. Of very many the first ones.
        undelivered: Frames that were not handed to zenoh because there was no transport.
    """

    endpoint: str
    namespace: str
    model: str
    zid: str = ""
    is_up: bool = False
    up_ns: int = 0
    trouble: str = ""
    router_zid: str = ""
    router_version: str = ""
    clock_ns: int | None = None
    robots: tuple[str, ...] = ()
    bridges: tuple[WireBridge, ...] = ()
    topics: tuple[WireTopic, ...] = ()
    neighbours: tuple[WireNeighbour, ...] = ()
    undelivered: int = 0
