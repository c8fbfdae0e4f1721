"""How the library behind numpy's products computes: one thread, and the same kernels on every x86-64 of ten years.

OpenBLAS chooses kernels by the processor, and they round differently: a recording of one computer would not replay to
the last bit on another. Those of Haswell run wherever there are AVX2 and FMA.

Rules of this file: called before numpy is imported, so that nothing here imports it; what the user has set stays.
"""

from __future__ import annotations

import os
import platform
from collections.abc import MutableMapping
from pathlib import Path

CPU_INFO = Path("/proc/cpuinfo")
KERNELS, NEEDED = "Haswell", frozenset({"avx2", "fma"})


def settle(environment: MutableMapping[str, str] = os.environ, cpu_info: Path = CPU_INFO) -> None:
    """Set what OpenBLAS reads when it is loaded."""
    # matrices of four by four gain nothing from threads, and lose milliseconds to them
    environment.setdefault("OPENBLAS_NUM_THREADS", "1")
    if platform.machine() == "x86_64" and flags(cpu_info) >= NEEDED:
        environment.setdefault("OPENBLAS_CORETYPE", KERNELS)


def flags(cpu_info: Path) -> frozenset[str]:
    """What the processor can do; nothing where nobody tells."""
    try:
        lines = cpu_info.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return frozenset()
    told = next((line for line in lines if line.startswith("flags")), "")
    return frozenset(told.partition(":")[2].split())
