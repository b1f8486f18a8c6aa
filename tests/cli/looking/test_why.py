"""Tests of `ta2 why`, and of findings in the other views."""

from __future__ import annotations

from msgspec.structs import replace

from gateway.cli.looking.frame import Picture, frame
from gateway.cli.looking.status import lines as status_lines
from gateway.cli.terminal.advice import next_steps
from gateway.messages.snapshot import Finding, RefusalMessage
from tests.api.stand_in import a_snapshot
from tests.cli.views import INFO, S, a_view, all_topics

STALL = Finding(
    code="TRACKING_STALL",
    message="left arm joint 7 stays at 0.100 rad",
    hint="look for contact, then recover()",
    since_ns=998 * S,
    facts={"joint": 7.0, "off_rad": 0.4},
)
NOT_ENABLED = RefusalMessage(
    code="NOT_ENABLED",
    message="the arms are not enabled",
    field="",
    value="",
    bound="",
    unit="",
    hint="call enable() first",
)
LATCHED = replace(NOT_ENABLED, code="LATCHED", message="motion is latched off", hint="then recover()")
IN_VR = Finding(code="MODE_VR", message="the robot is in VR mode", hint="set API mode", since_ns=999 * S, facts={})


def test_why_tells_what_was_inferred_and_what_to_do(shell):
    """Code and since when, what is seen, the remedy as a shell has it; then what else stands in the way."""
    shell.world.engine.show(findings=(STALL,), latches={"ESTOP": "by hand"}, shown="ESTOP")
    ended = shell.run("why")
    assert ended.status == 0 and not ended.err
    first, second, third, *rest = ended.out.splitlines()
    assert first.startswith("TRACKING_STALL  for ") and "joint 7 stays" in second and "`ta2 recover`" in third
    assert any("ESTOP: by hand" in line for line in rest) and not any("TRACKING_STALL" in line for line in rest)
    assert shell.names == ["ta2 why"]


def test_why_says_that_nothing_is_in_the_way(shell):
    """The line of advice for the state is all there is then."""
    shell.world.engine.show(topics={})
    ended = shell.run("why")
    assert ended.status == 0 and ended.out.count("\n") == 1 and "nobody owns" in ended.out


def test_why_tells_what_would_be_refused(shell):
    """Kinds with the same reason stand in one line, with the remedy as a shell has it."""
    shell.world.engine.show(topics={}, refusals={"left_arm": NOT_ENABLED, "right_arm": NOT_ENABLED, "chassis": LATCHED})
    lines = shell.run("why").out.splitlines()
    assert lines[0].startswith("refused now: left_arm, right_arm  NOT_ENABLED: the arms are not enabled -> ")
    assert lines[1].startswith("refused now: chassis  LATCHED: ") and "`ta2 recover`" in lines[1]
    document = shell.run("why", "--json").json
    assert document["refusals"]["chassis"]["code"] == "LATCHED" and set(document["refusals"]["chassis"]) >= {"hint"}


def test_why_as_json_is_for_programs(shell):
    """State, latches, findings with their numbers."""
    shell.world.engine.show(findings=(STALL,), latches={"ESTOP": "by hand"}, shown="ESTOP")
    document = shell.run("why", "--json").json
    assert document["state"] == "ESTOP" and document["latches"] == {"ESTOP": "by hand"}
    (finding,) = document["findings"]
    assert finding["code"] == "TRACKING_STALL" and finding["facts"] == {"joint": 7.0, "off_rad": 0.4}
    assert finding["hint"] == STALL.hint and finding["since_s"] >= 0.0


def test_findings_are_seen_in_status_and_watch():
    """Whoever looks sees them without asking for them; what the modes say is said once."""
    view = a_view(findings=(STALL, IN_VR))
    for texts in (
        [line.plain for line in status_lines(INFO, view)],
        [line.plain for line in frame(Picture(address="x", info=INFO, view=view, since_ns=0, remarks=()), 160, 50)],
        [step.text for step in next_steps(view, INFO)],
    ):
        assert sum("TRACKING_STALL" in text and "`ta2 recover`" in text for text in texts) == 1
        assert not any("MODE_VR" in text for text in texts)


def test_what_a_finding_says_of_the_modes_is_not_said_again(shell):
    """VR mode and a disabled arm stand among the findings of `ta2 why`, and nowhere else."""
    off = replace(IN_VR, code="ARM_DISABLED", message="the left arm is disabled")
    mode = replace(a_snapshot().mode, arm_enabled={"left": False, "right": True})
    for finding, changed in ((IN_VR, replace(mode, api=False, arm_enabled={"left": True, "right": True})), (off, mode)):
        shell.world.engine.show(topics={}, findings=(finding,), mode=changed)
        out = shell.run("why").out
        assert out.count("VR mode") + out.count("is disabled") == 1, out


def test_a_silent_topic_is_told_once():
    """By the finding, which knows more; without one by its age."""
    topics = all_topics()
    topics["/fsm_state"] = type(topics["/fsm_state"])(
        age_ns=5 * S, rate_hz=0.0, worst_gap_ns=0, count=1, duplicates=0, refused=0
    )
    silent = Finding(code="ROUTE_SUSPECT", message="/fsm_state is silent", hint="see", since_ns=0, facts={})
    for findings in ((), (silent,)):
        texts = [step.text for step in next_steps(a_view(topics=topics, findings=findings), INFO)]
        assert sum("/fsm_state" in text for text in texts) == 1
