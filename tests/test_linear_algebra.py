"""The kernels of the linear algebra library are the same on every processor that has what they need."""

from __future__ import annotations

import os
import platform
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info

from hoopd.linear_algebra import CPU_INFO, KERNELS, NEEDED, flags, settle


@pytest.mark.parametrize(("can", "kernels"), [("fma sse2 avx2 avx512f", KERNELS), ("sse2 avx2", None), ("", None)])
def test_kernels_are_fixed_where_they_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, can: str, kernels: str | None
) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    (tmp_path / "cpuinfo").write_text(f"processor : 0\nflags\t\t: {can}\nbugs :\n")
    environment: dict[str, str] = {}
    settle(environment, tmp_path / "cpuinfo")
    assert environment.get("OPENBLAS_CORETYPE") == kernels and environment["OPENBLAS_NUM_THREADS"] == "1"
    settle(environment := {"OPENBLAS_CORETYPE": "Zen", "OPENBLAS_NUM_THREADS": "3"}, tmp_path / "cpuinfo")
    assert environment == {"OPENBLAS_CORETYPE": "Zen", "OPENBLAS_NUM_THREADS": "3"}


def test_another_processor_keeps_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    settle(environment := {}, tmp_path / "none")
    assert environment == {"OPENBLAS_NUM_THREADS": "1"} and flags(tmp_path / "none") == frozenset()


@pytest.mark.skipif(not flags(CPU_INFO) >= NEEDED, reason="a processor without AVX2 and FMA")
def test_the_tests_compute_with_them() -> None:
    import numpy as np

    assert os.environ["OPENBLAS_CORETYPE"] == KERNELS
    assert np.eye(2).sum() == 2.0
    found = {one.get("architecture") for one in threadpool_info() if one["internal_api"] == "openblas"}
    assert found == {KERNELS}
