"""Rules of the robot's own log."""

from __future__ import annotations

from gateway.sim.robot.journal import Journal
from gateway.sim.robot.manual import MS, S


def test_every_event_counts_but_repeats_are_written_once_a_second():
    """A refused 100 Hz stream fills one line a second, and its count is complete."""
    journal = Journal()
    for number in range(250):
        journal.note(number * 10 * MS, "CLIPPED", "left arm joint_cmd", f"value {number}")
    assert journal.counts["CLIPPED"] == 250
    assert [entry.now_ns for entry in journal.entries] == [0, 1 * S, 2 * S]


def test_subjects_and_codes_are_told_apart():
    """The second within which a repeat is left out belongs to one code about one subject."""
    journal = Journal()
    journal.note(0, "CLIPPED", "left")
    journal.note(0, "CLIPPED", "right")
    journal.note(0, "REFUSED_SHORT", "left", "6 values")
    assert [(entry.code, entry.text) for entry in journal.entries] == [
        ("CLIPPED", "left"),
        ("CLIPPED", "right"),
        ("REFUSED_SHORT", "left: 6 values"),
    ]
    assert journal.codes() == {"CLIPPED", "REFUSED_SHORT"}


def test_entries_after_a_number_can_be_followed():
    """A reader that remembers the last number gets each entry once."""
    journal = Journal()
    for number in range(5):
        journal.note(0, f"CODE_{number}", "x")
    assert [entry.number for entry in journal.since(3)] == [4, 5]
    assert journal.since(5) == []


def test_only_the_last_thousand_entries_are_kept():
    """The log does not grow for ever."""
    journal = Journal()
    for number in range(1500):
        journal.note(0, f"CODE_{number}", "x")
    assert len(journal.entries) == 1000
    assert journal.entries[0].number == 501
