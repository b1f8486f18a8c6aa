"""Kinematics: inverse of random configurations in closed form, beside pinocchio's own closed-loop example; forward, Jacobian.

Dynamics: what both arms' observers cost a tick, beside the calls of pinocchio in them.

The peer is the loop of pinocchio's "Inverse kinematics (closed-loop)" example with its own numbers (eps 1e-4, dt 0.1, damping
1e-12, at most 1000 steps), in Python as published, on a model of one arm alone. It knows no limits.
"""

from __future__ import annotations

import math
import random
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gateway.kinematics.arm import ArmModel
from gateway.kinematics.description import arm_joint, ee_frame, nominal
from gateway.kinematics.placement import Placement, turn_rad
from gateway.kinematics.solving.inverse import Solution
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import ArmState, EePose, Side, Vector
from tests.bench.table import Row

try:
    import pinocchio as pin
except ImportError:
    pin = None

__all__ = ["kinematics_rows"]

COUNT = 100_000
PEERS_COUNT = 300
GOAL_US = 50.0
GOAL_SOLVED = 0.999
GOAL_OFF = 1e-9
GOAL_FELT_US = 200.0
EPS, DT, DAMPING, STEPS = 1e-4, 1e-1, 1e-12, 1000
"""Of the example."""

Problem = tuple[Side, Placement, EePose, Vector, Vector]


def kinematics_rows(count: int = COUNT) -> list[Row]:
    """Measure both arms, half of the configurations each.

    Args:
        count: Random configurations for each way to begin.
    """
    arms = {side: ArmModel(nominal(), side) for side in Side}
    rows = [
        _inverse_row(name, arms, list(_problems(arms, count, near)))
        for name, near in (("from home", 0.0), ("from 0.05 rad beside", 0.05))
    ]
    return [*rows, *_plain_rows(arms), *_felt_rows()]


def _problems(arms: dict[Side, ArmModel], count: int, near: float) -> Any:
    """Yield side, target, pose, seed and the configuration that it was made from."""
    rng = random.Random(count)
    for number in range(count):
        side = Side.LEFT if number % 2 else Side.RIGHT
        q = tuple(rng.uniform(a, b) for a, b in zip(JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True))
        target = arms[side].chain.forward(q)
        seed = tuple(v + rng.uniform(-near, near) for v in q) if near else HOME_Q_RAD[side]
        yield side, target, target.pose, seed, q


def _inverse_row(name: str, arms: dict[Side, ArmModel], problems: Sequence[Problem]) -> Row:
    taken_us: list[float] = []
    off = solved = 0.0
    for side, target, pose, seed, _ in problems:
        begun = time.perf_counter_ns()
        found = arms[side].solution(pose, seed)
        taken_us.append((time.perf_counter_ns() - begun) / 1e3)
        if isinstance(found, Solution):
            at = arms[side].chain.forward(found.q_rad)
            residual = max(math.dist(at.p_m, target.p_m), math.hypot(*turn_rad(at.rows, target.rows)))
            solved += residual < GOAL_OFF
            off = max(off, residual)
    taken_us.sort()
    part, p50 = solved / len(problems), taken_us[len(taken_us) // 2]
    peer_p50, peer_part = _peer(problems[:PEERS_COUNT])
    return Row(
        name=f"inverse kinematics of {len(problems):,}, {name}",
        ours=f"p50 {p50:.0f}, p99 {taken_us[int(0.99 * len(taken_us))]:.0f} us; {part:.3%} solved, {off:.0e} m, rad off",
        peer=f"closed-loop p50 {peer_p50:.0f} us, {peer_part:.1%} within {EPS:g}"
        if peer_p50
        else "pinocchio is not installed",
        ratio=f"{peer_p50 / p50:.0f}x" if peer_p50 else "",
        goal=f"p50 <= {GOAL_US:g} us, >= {GOAL_SOLVED:.1%}, < {GOAL_OFF:g}",
        good=p50 <= GOAL_US and part >= GOAL_SOLVED and off < GOAL_OFF,
    )


def _peer(problems: Sequence[Problem]) -> tuple[float, float]:
    """Return the median time of the example's loop [us], and which part of the problems it solves; zeros without it."""
    if pin is None:
        return 0.0, 0.0
    bodies = {side: _one_arm(side) for side in Side}
    taken_us: list[float] = []
    solved = 0
    for side, _, _, seed, q in problems:
        model, data, frame = bodies[side]
        pin.framesForwardKinematics(model, data, np.array(q))
        wanted = data.oMf[frame].copy()
        start = np.array(seed)
        begun = time.perf_counter_ns()
        solved += _clik(model, data, frame, wanted, start)
        taken_us.append((time.perf_counter_ns() - begun) / 1e3)
    return statistics.median(taken_us), solved / len(problems)


def _one_arm(side: Side) -> tuple[Any, Any, int]:
    """Return a model of one arm, its data, and the index of its end-effector frame."""
    from gateway.kinematics.pin_model import pin_model

    body = pin_model(nominal())
    arm = {arm_joint(side, n) for n in range(1, 8)}
    others = [body.getJointId(name) for name in list(body.names)[1:] if name not in arm]
    model = pin.buildReducedModel(body, others, pin.neutral(body))
    return model, model.createData(), model.getFrameId(ee_frame(side))


def _clik(model: Any, data: Any, frame: int, wanted: Any, q: np.ndarray) -> bool:
    """Run the example's loop; return whether it converged."""
    for _ in range(STEPS):
        pin.framesForwardKinematics(model, data, q)
        to_wanted = data.oMf[frame].actInv(wanted)
        error = pin.log(to_wanted).vector
        if np.linalg.norm(error) < EPS:
            return True
        jacobian = pin.computeFrameJacobian(model, data, q, frame)
        jacobian = -np.dot(pin.Jlog6(to_wanted.inverse()), jacobian)
        speed = -jacobian.T.dot(np.linalg.solve(jacobian.dot(jacobian.T) + DAMPING * np.eye(6), error))
        q = pin.integrate(model, q, speed * DT)
    return False


def _plain_rows(arms: dict[Side, ArmModel]) -> list[Row]:
    arm, q = arms[Side.LEFT], HOME_Q_RAD[Side.LEFT]
    peers: dict[str, Callable[[], object]] = {}
    if pin is not None:
        model, data, frame = _one_arm(Side.LEFT)
        there = np.array(q)
        peers = {
            "forward kinematics": lambda: pin.framesForwardKinematics(model, data, there),
            "Jacobian": lambda: pin.computeFrameJacobian(model, data, there, frame),
        }
    ours: dict[str, Callable[[], object]] = {
        "forward kinematics": lambda: arm.chain.forward(q),
        "Jacobian": lambda: arm.jacobian(q),
        "manipulability and singularity": lambda: arm.dexterity(q),
    }
    rows = []
    for name, call in ours.items():
        here, peer = _best_us(call), _best_us(peers[name]) if name in peers else 0.0
        rows.append(
            Row(
                name=f"{name}, one arm",
                ours=f"{here:.1f} us",
                peer=f"pinocchio {peer:.1f} us" if peer else "",
                ratio=f"{peer / here:.1f}x" if peer else "",
            )
        )
    return rows


def _felt_rows() -> list[Row]:
    """Measure what a tick costs that hears joints of both arms, without and with a snapshot."""
    if pin is None:
        return []
    from gateway.core.robot_state.contact import Contact, Contacts
    from gateway.kinematics.dynamics.loading import load_dynamics
    from gateway.settings.settings import ModelSettings, Settings

    dynamics = load_dynamics(Settings(model=ModelSettings(dynamics=True)))
    contacts = Contacts(dynamics, lambda side, now_ns: None)
    now_ns, some = 0, (0.1,) * 7

    def hear() -> None:
        nonlocal now_ns
        now_ns += 10_000_000
        for side in Side:
            state = ArmState(q_rad=HOME_Q_RAD[side], dq_radps=some, tau_nm=some, stamp_ns=now_ns)
            contacts.hear(side, state, now_ns, (0.0, 0.0, 0.0))

    def show() -> None:
        hear()
        for side in Side:
            contacts.view(side, now_ns)

    for _ in range(100):
        hear()
    assert isinstance(contacts.contact(Side.LEFT, now_ns), Contact)
    model: Any = dynamics[Side.LEFT].model  # type: ignore[attr-defined]  # pinocchio's, of the class behind the protocol
    data, q, v = model.createData(), np.zeros(model.nq), np.zeros(model.nv)

    def plain() -> None:
        for _ in Side:
            pin.crba(model, data, q)
            pin.computeCoriolisMatrix(model, data, q, v)
            pin.computeGeneralizedGravity(model, data, q)

    rows = []
    for name, call in (("a tick", hear), ("a tick with a snapshot", show)):
        here, peer = _best_us(call), _best_us(plain)
        rows.append(
            Row(
                name=f"what pulls at both arms, {name}",
                ours=f"{here:.0f} us",
                peer=f"pinocchio's calls alone {peer:.0f} us",
                ratio=f"{peer / here:.1f}x",
                goal=f"<= {GOAL_FELT_US:g} us",
                good=here <= GOAL_FELT_US,
            )
        )
    return rows


def _best_us(call: Callable[[], object]) -> float:
    best = math.inf
    for _ in range(20):
        begun = time.perf_counter_ns()
        for _ in range(200):
            call()
        best = min(best, (time.perf_counter_ns() - begun) / 200 / 1e3)
    return best
