"""What names of `hoopd.ident` were before, and what other toolboxes call them.

Rules of this file: data alone.
"""

# What was called otherwise: an old name says the one that the field has.
FORMER = {
    "applied": "apply",
    "balanced": "balance",
    "empirical": "etfe",
    "filtered": "idfilt",
    "joined": "concatenate",
    "merged": "merge",
    "normalised": "normalize",
    "reduced": "reduce",
    "resampled": "d2d",
    "resampled_covariance": "resample_covariance",
    "resampled_system": "resample_system",
    "response": "frequency_response",
    "sampled": "c2d",
    "scaled": "scale",
    "smoothed": "smooth",
    "stabilise": "stabilize",
    "transformed": "fft",
    "unsampled": "d2c",
}

# What other toolboxes call by names that this package does not have.
ELSEWHERE = {
    "advice": "the warnings of a model's `summary()`",
    "arxstruc": "`scan(data, na, nb, delay)`",
    "delayest": "`delay(data)`",
    "getcov": "a model's `covariance` and `deviations()`",
    "getpvec": "a model's `values` and `deviations()`",
    "idfrd": "`frequency_response(model, w)` and python-control's FRD",
    "idpoly": "`Polynomials`",
    "idss": "`Innovations`",
    "impulse": "`hoopd.plots.impulse(model)`",
    "misdata": "`fill_gaps(data).data`, or `smooth(model, data)` by a model",
    "n4sid": "`subspaceid(data, order)`",
    "nlhw": "`hammerstein_wiener`",
    "nlarx": "`nonlinear_pem` of a model that you write",
    "present": "what `print(model)` says",
    "procest": "`srivc(data, poles, zeros)`",
    "recursiveARX": "`RecursiveArx`",
    "selstruc": "`scan(...).best(criterion)`",
    "sim": "`simulate(model, data)`",
    "spa": "`tfest(data)`, by the name of ControlSystemIdentification.jl",
    "ssest": "`subspaceid(data, order)`, refined by `pem(data, order)`",
    "ssregest": "`subspaceid(data, order)`",
}
