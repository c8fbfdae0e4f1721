"""Numbers of samples that count, over all recordings and of each.

Rules of this file: numbers that others counted; nothing is judged here.
"""

from __future__ import annotations

from collections.abc import Sequence

from hoopd.diagnose.inputs import Source
from hoopd.diagnose.quality.unusual_intervals import Interval
from hoopd.diagnose.record import DataQuality, RecordingQuality


def quality_of(sources: Sequence[Source], aside: Sequence[Interval], notes: Sequence[str] = ()) -> DataQuality:
    """Numbers of samples over all recordings, and of each."""
    each: dict[str, RecordingQuality] = {}
    for source in {source.name: source for source in sources}.values():
        counts = source.quality.data_quality()
        own = [(i.t0, i.t1, i.reason) for i in aside if i.recording == source.name]
        segments = [(a - source.start_s, b - source.start_s, why) for a, b, why in counts["segments_ignored"]]
        each[source.name] = RecordingQuality(
            missing=counts["missing"],
            late_frames=counts["late_frames"],
            outliers=counts["outliers"],
            segments_ignored=sorted([*segments, *own]),
            samples=counts["samples"],
            frames=counts["frames"],
            notes=list(source.quality.notes),
            jumps={name: len(found) for name, found in source.quality.jumps.items() if found},
        )
    return DataQuality(
        missing=sum(one.missing or 0 for one in each.values()),
        late_frames=sum(one.late_frames or 0 for one in each.values()),
        outliers=sum(one.outliers or 0 for one in each.values()),
        samples=sum(one.samples or 0 for one in each.values()),
        frames=sum(one.frames or 0 for one in each.values()),
        segments_ignored=[one for part in each.values() for one in part.segments_ignored],
        recordings=each,
        notes=list(notes),
    )
