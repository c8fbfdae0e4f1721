"""Do the pictures come from a camera that sees the ball now? Four conditions of the fault table, tick by tick.

A camera may deliver pictures at the right times that are not true: the same one again and again, an angle that is not
measured, a ball that is not the one in the hoop. What cannot be told from the angle and the encoder alone is listed in
docs/explanations/lies.md.

Rules of this file: pure; a condition is judged from samples that came; without a ball expected nothing is judged.
"""

from __future__ import annotations

from collections import deque
from math import inf, isfinite, nan, sqrt, tau
from statistics import median

from hoopd.core.ballresponse import BallMotion, BallResponse
from hoopd.core.inorder import dot
from hoopd.core.records import CameraSample, DriverSample, Inputs

NAMES = ("pictures_identical", "angle_stuck", "angle_noiseless", "ball_unresponsive")
# Without torque for this many ticks a hand may hold ball and hoop.
IDLE_TICKS = 25

# A sensor's noise makes each picture's corners differ. So many in a row that did, half of what arming waits for, and it
# is known of this camera that they do; one whose corners are black and clipped never shows it and is not judged.
DIFFERENT_PICTURES = 25
IDENTICAL_PICTURES = 10

# An angle that is equal to the last bit is no measurement of a ball that moved: three sigma of the filter's camera.
STUCK_PICTURES = 10
MOVED_RAD = 0.012
# The picture is this much older than its stamp at most while nothing is wrong.
LATE_S = 0.06
LONGEST_GAP_S = 0.1  # between two answers of the board; a longer one begins anew

# The fifth difference of a swing of half a radian, with the ball's 8.6 rad/s at 50 pictures a second, is 0.1 mrad; that
# of white noise is sqrt(252) times its deviation.
ORDER = (1.0, -5.0, 10.0, -10.0, 5.0, -1.0)
NOISE_GAIN = sqrt(252.0)
BLOCK = 25  # differences: half a second, the deviation is known to 20 %
BLOCKS = 2
HALF = 0.6745  # half of what is normal lies within so many deviations
LOST_SHARE = 0.125
LEAST_NOISE_RAD = 1e-5  # a five hundredth of a pixel: a camera of less has no noise that could be missed
# Five sigma of the filter's camera: what is more is no noise but several false detections in half a second.
MOST_NOISE_RAD = 0.02


class IdenticalPictures:
    """Counts pictures that are equal to the one before, once the camera is known to have noise."""

    def __init__(self) -> None:
        self._last, self._same, self._different = 0, 0, 0

    def update(self, camera: CameraSample) -> bool:
        """The same picture has come too often."""
        if camera.corners == 0:  # not told
            return False
        same, self._last = camera.corners == self._last, camera.corners
        self._same = self._same + 1 if same else 0
        if self._different < DIFFERENT_PICTURES:
            self._different = 0 if same else self._different + 1
        return self._different >= DIFFERENT_PICTURES and self._same >= IDENTICAL_PICTURES


class StuckAngle:
    """An angle that is exactly the same, and how far the hoop's motion must have moved a ball meanwhile.

    z'' = carried theta'' - stiffness z from z = z' = 0 at the first of the equal angles
    """

    def __init__(self, motion: BallMotion) -> None:
        self._motion = motion
        self._psi = nan
        self._restart()

    def _restart(self) -> None:
        self._same = 0
        self._z = self._rate = self._moved = 0.0
        self._before: DriverSample | None = None
        self._path: deque[tuple[float, float]] = deque(maxlen=25)

    def follow(self, driver: DriverSample) -> None:
        """Move the forecast on to the newest answer."""
        before, self._before = self._before, driver
        if before is None or not 0.0 < (h := driver.t - before.t) < LONGEST_GAP_S:
            return
        self._rate += self._motion.carried * (driver.dtheta - before.dtheta) - self._motion.stiffness * self._z * h
        self._z += self._rate * h
        self._path.append((driver.t, abs(self._z)))

    def update(self, camera: CameraSample) -> bool:
        """The angle is no measurement."""
        if camera.psi != self._psi:  # NaN too
            self._psi = camera.psi
            self._restart()
            return False
        self._same += 1
        while self._path and self._path[0][0] <= camera.t - LATE_S:
            self._moved = max(self._moved, self._path.popleft()[1])
        return self._same >= STUCK_PICTURES and self._moved > MOVED_RAD


class AngleNoise:
    """The noise of the angle, learned while no torque acts: what is measured later has it, too."""

    def __init__(self) -> None:
        self._angles: deque[float] = deque(maxlen=len(ORDER))
        self._frame = -1
        self._sizes: list[float] = []
        self._quiet = 0
        self.floor_rad = inf

    def update(self, camera: CameraSample, *, acting: bool) -> bool:
        """The angle has lost its noise."""
        if camera.frame != self._frame + 1 or not isfinite(camera.psi):
            self._angles.clear()
        self._frame = camera.frame
        if isfinite(camera.psi):
            before = self._angles[-1] if self._angles else camera.psi
            self._angles.append(camera.psi + tau * round((before - camera.psi) / tau))
        if len(self._angles) == len(ORDER):
            difference = dot(ORDER, self._angles)
            self._sizes.append(abs(difference))
        if len(self._sizes) == BLOCK:
            self._close(acting=acting)
        return self._quiet >= BLOCKS

    def _close(self, *, acting: bool) -> None:
        # by the median: a false detection among the pictures spoils six differences and is no noise
        noise = median(self._sizes) / (HALF * NOISE_GAIN)
        self._sizes.clear()
        quiet = isfinite(self.floor_rad) and noise < LOST_SHARE * self.floor_rad
        self._quiet = self._quiet + 1 if quiet else 0
        # an angle without any noise teaches nothing: half a second of a picture that hangs would switch the row off
        if not acting and not quiet and LEAST_NOISE_RAD < noise < MOST_NOISE_RAD:
            self.floor_rad = min(self.floor_rad, noise)


class PictureChecks:
    """The four conditions; what is judged of the ball needs the model of one."""

    def __init__(self, motion: BallMotion | None) -> None:
        """None: no model of a ball, so that only pictures and noise are judged."""
        self._identical, self._noise = IdenticalPictures(), AngleNoise()
        self._idle = IDLE_TICKS
        self._held = dict.fromkeys(NAMES, 0)
        self.follow(motion)

    def follow(self, motion: BallMotion | None) -> None:
        """Another model of the ball, from now on; what pictures have shown of themselves stays."""
        self._stuck = None if motion is None else StuckAngle(motion)
        self._response = None if motion is None else BallResponse(motion)

    def begin(self) -> None:
        """The operator has armed: what was held against the ball before is over."""
        if self._response is not None:
            self._response.reset()

    def update(self, inputs: Inputs, torque_nm: float) -> dict[str, int]:
        """Weights by name; a verdict on pictures holds until the next one. `torque_nm`: what the last tick sent."""
        self._idle = 0 if torque_nm != 0.0 else self._idle + 1
        acting, camera = self._idle < IDLE_TICKS, inputs.camera
        held = self._held
        if camera is not None:
            held["pictures_identical"] = int(self._identical.update(camera))
            held["angle_noiseless"] = int(self._noise.update(camera, acting=acting))
        if self._stuck is not None:
            if inputs.driver is not None:
                self._stuck.follow(inputs.driver)
            if camera is not None:
                held["angle_stuck"] = int(self._stuck.update(camera) and acting)
        if self._response is not None:
            held["ball_unresponsive"] = int(self._response.update(inputs.driver, camera, acting=acting))
        return dict(held)
