"""The size of a JPEG by its header: that of every encoder's pictures, and none of what is written otherwise."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from hoopd.vision.jpeg_size import jpeg_size


def encoded(height: int, width: int, *settings: int, channels: int = 3) -> bytes:
    picture = np.zeros((height, width, channels), np.uint8)
    return cv2.imencode(".jpg", picture, list(settings))[1].tobytes()


@pytest.mark.parametrize(
    "settings",
    [(), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1), (cv2.IMWRITE_JPEG_OPTIMIZE, 1), (cv2.IMWRITE_JPEG_RST_INTERVAL, 4)],
)
def test_the_size_is_the_picture_s(settings: tuple[int, ...]) -> None:
    assert jpeg_size(encoded(36, 480, *settings)) == (480, 36)
    assert jpeg_size(encoded(7, 9, *settings, channels=1)) == (9, 7)


def test_what_is_cut_changed_or_no_jpeg_has_none() -> None:
    whole = encoded(36, 480)
    frame = whole.index(b"\xff\xc0")
    assert [jpeg_size(whole[:k]) for k in range(frame + 9)] == [None] * (frame + 9)
    assert jpeg_size(whole[:frame] + b"\x00" + whole[frame:]) is None  # a decoder may skip it and find another frame
    assert jpeg_size(whole[: frame + 5] + bytes(4) + whole[frame + 9 :]) is None
    assert jpeg_size(cv2.imencode(".png", np.zeros((9, 9), np.uint8))[1].tobytes()) is None
