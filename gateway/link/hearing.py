"""Which state topics are heard, how their samples are kept, and how often the newest one is decoded. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from gateway.link.mailbox import Mailbox, Tray
from gateway.robot.topics import CURRENT_MODE, FSM_STATE, JOINT_STATE, TOPICS, arm_state, ee_pose
from gateway.values import Side

__all__ = ["AT_ONCE", "DECIDING", "DECISIVE", "POSED", "SHOWN", "STAMPED", "mailboxes_of", "slots_of"]

AT_ONCE, DECISIVE, POSED, SHOWN = range(4)
"""Classes of topics, by how often their newest sample is decoded; poses decide about arms in end-effector mode."""

CLASSES = {
    **dict.fromkeys(map(arm_state, Side), DECISIVE),
    **dict.fromkeys((FSM_STATE, CURRENT_MODE), AT_ONCE),
    **dict.fromkeys(map(ee_pose, Side), POSED),
}
DECIDING = frozenset(CLASSES)
"""State topics that decide about motion, or may. The others are only shown."""
STAMPED = DECIDING - {topic for topic, kind in CLASSES.items() if kind == POSED}
"""Those of them whose samples are stamped when they arrive. Poses decide in end-effector mode only, and are looked at on
every tick then: they count as older than they are by at most the time since the tick before. That saves 400 wake-ups of
a thread a second, in every mode."""


def mailboxes_of(topics: Collection[str], stamped: Collection[str]) -> dict[str, Mailbox]:
    """Return a mailbox for each topic; a tray for those whose samples need no stamp of their arrival."""
    return {
        topic: (Mailbox if topic in stamped else Tray)(is_stamped=TOPICS[topic].type_name == JOINT_STATE)
        for topic in topics
    }


def slots_of(mailboxes: Mapping[str, Mailbox]) -> list[tuple[str, Mailbox, int]]:
    """Return topic, mailbox and class of each, what decides first."""
    slots = ((topic, box, CLASSES.get(topic, SHOWN)) for topic, box in mailboxes.items())
    return sorted(slots, key=lambda slot: slot[0] not in DECIDING)
