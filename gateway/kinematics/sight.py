"""Sight: where things of the robot's frames are in the six views of the video, and which direction a pixel looks in.

Lenses and mounts are the robot's own where its calibration has them; else stand-ins, and every result says which they
were. Nothing here judges how old joints or pictures are: a wrist's view needs the joints of the picture's moment.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from gateway.errors import Code, failure
from gateway.kinematics.calibration import Calibration
from gateway.kinematics.cameras.eyes import EYES, Eye, eyes_of, nominal_lens
from gateway.kinematics.cameras.lens import Lens, Projection
from gateway.kinematics.description import Description, nominal
from gateway.kinematics.frames import FrameTree, Located
from gateway.kinematics.nominal_frames import calibrated, nominal_edges
from gateway.kinematics.solving.chain import ArmChain
from gateway.kinematics.transform import Points
from gateway.values import ArmState, Side

__all__ = ["Seen", "Sight", "robot_frames"]

Array = NDArray[np.float64]


class Seen(Struct, frozen=True, kw_only=True):
    """Where points are in a view.

    Attributes:
        view: Name of the view (§5.2).
        projection: Pixels of the view, and whether they are in it. What stands in between is not known.
        located: Where the points' frame was in the eye's, with the joints' stamps and the stand-ins on the way.
        is_lens_stand_in: Whether the lens is a stand-in, not this robot's own.
    """

    view: str
    projection: Projection
    located: Located
    is_lens_stand_in: bool


def robot_frames(
    description: Description, arms: Mapping[Side, ArmChain], calibration: Calibration | None = None
) -> FrameTree:
    """Return the tree of a robot.

    Args:
        description: Numbers of the body.
        arms: Forward kinematics of both arms.
        calibration: Of this very robot (`calibration.load`); None for stand-ins.
    """
    own = () if calibration is None else calibration.edges
    return FrameTree(calibrated(nominal_edges(description), own), arms)


class Sight:
    """All six eyes of a robot.

    Args:
        tree: Its frames.
        description: Numbers of the body, for stand-ins of lenses.
        calibration: Of this very robot; None for stand-ins.
    """

    def __init__(self, tree: FrameTree, description: Description, calibration: Calibration | None = None) -> None:
        self.tree = tree
        """Its frames."""
        own = {} if calibration is None else calibration.cameras
        self._lenses: dict[str, Lens] = {}
        self._stand_ins: set[str] = set()
        for view, eye in EYES.items():
            if eye.camera in own:
                pair = own[eye.camera].view_pair
                self._lenses[view] = pair.left if eye is eyes_of(eye.camera)[0] else pair.right
            else:
                self._lenses[view] = nominal_lens(description.cameras[eye.camera])
                self._stand_ins.add(view)

    @staticmethod
    def of(calibration: Calibration | None = None, description: Description | None = None) -> Sight:
        """Return the eyes of a robot.

        Args:
            calibration: Of this very robot (`calibration.load`); None for stand-ins.
            description: Numbers of the body (`urdf.from_urdf`); None for our own.

        Raises:
            ConfigError: BAD_CONFIG, the calibration has joint zeros that were identified on other numbers.
        """
        body = nominal() if description is None else description
        if calibration is not None:
            body = calibration.body(body)
        arms = {side: ArmChain(body, side) for side in Side}
        return Sight(robot_frames(body, arms, calibration), body, calibration)

    def _eye(self, view: str) -> Eye:
        eye = EYES.get(view)
        if eye is None:
            message = f"there is no view {view!r} (manual §5.2)"
            raise failure(Code.BAD_REQUEST, message, hint=f"one of {', '.join(EYES)}")
        return eye

    def lens(self, view: str) -> Lens:
        """Return the lens of a view, for its pixels.

        Raises:
            Rejected: BAD_REQUEST, there is no such view.
        """
        return self._lenses[self._eye(view).view]

    def project(self, view: str, points: Points, joints: Mapping[Side, ArmState] | None = None) -> Seen:
        """Return where points are in a view.

        Args:
            view: Name of the view (§5.2).
            points: In any frame of the tree.
            joints: Of the arms between that frame and the eye.

        Raises:
            Rejected: BAD_REQUEST, there is no such view; WRONG_FRAME, there is no such frame.
            Stale: PART_STALE, the joints of an arm on the way are not there.
        """
        eye = self._eye(view)
        located = self.tree.locate(eye.frame, points.frame, joints)
        return Seen(
            view=view,
            projection=self._lenses[view].project((located.transform @ points).xyz_m),
            located=located,
            is_lens_stand_in=view in self._stand_ins,
        )

    def rays(
        self, view: str, px: ArrayLike, frame: str, joints: Mapping[Side, ArmState] | None = None
    ) -> tuple[Array, Located]:
        """Return the directions in which pixels of a view look, in any frame of the tree.

        Args:
            view: Name of the view (§5.2).
            px: u, v, shape (..., 2) [px].
            frame: Frame of the result.
            joints: Of the arms between.

        Returns:
            Unit vectors, shape (..., 3), NaN where the lens has none; and where the eye is in that frame: the rays start at
            `transform.p_m`.

        Raises:
            Rejected: BAD_REQUEST, there is no such view; WRONG_FRAME, there is no such frame.
            Stale: PART_STALE, the joints of an arm on the way are not there.
        """
        eye = self._eye(view)
        located = self.tree.locate(frame, eye.frame, joints)
        return self._lenses[view].rays(px) @ located.transform.rotation.T, located
