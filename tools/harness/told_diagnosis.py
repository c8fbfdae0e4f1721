"""Diagnoses as a campaign reads them, written by hand."""

from __future__ import annotations

from typing import Any

import msgspec

from hoopd.diagnose.record import (
    SCHEMA,
    Base,
    Candidate,
    DataQuality,
    Diagnosis,
    EffectFinding,
    Evidence,
    FitTable,
    Location,
    NextExperiment,
)


def said(probability: float | None = None, status: str = "confirmed", none: float = 0.07, **more: Any) -> Diagnosis:
    """Nothing is missing without a probability, Coulomb's friction with this one else."""
    friction = EffectFinding(
        name="hoop.coulomb_friction", slot="hoop", parameters={}, not_excluded=[], statement="dry friction",
        evidence=Evidence(log_likelihood_gain=90.0, threshold=10.0, heldout_gain_percent=2.0),
        probability=probability, status=status,
    )  # type: ignore[arg-type]  # fmt: skip
    shares = {"parameters": 1.0 - none} if probability is None else {friction.name: probability}
    shares["none of these"] = none
    plain = Diagnosis(
        schema=SCHEMA, verdict="consistent" if probability is None else "missing_physics",
        base=Base(model="hoop", parameters={}), location=Location.nowhere(),
        effects=[] if probability is None else [friction], fit=FitTable(train={}, heldout={}), unexplained=None,
        next_experiment=None, seed=0,
        data_quality=DataQuality(missing=0, late_frames=0, outliers=0, segments_ignored=[]),
        candidates=[Candidate(name=name, log_likelihood_gain=None, probability=one) for name, one in shares.items()],
    )  # fmt: skip
    return msgspec.structs.replace(plain, **more)


def proposal(nats: float, command: str = "hoopd experiment multisine --low 0.05 --sim --seed 3") -> NextExperiment:
    """To tell two frictions apart."""
    return NextExperiment(
        signal="slow reversals", parameters={}, tells_apart=("hoop.stribeck_friction", "hoop.coulomb_friction"),
        expected_nats=nats, command=command,
    )  # fmt: skip
