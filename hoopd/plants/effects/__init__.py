"""Effects: what a model may leave out, one file per slot; `library` collects those that fit a plant.

Rules of this package: an effect is declared once, in base.Effect; simulator, filter and search take it from here.
"""

from __future__ import annotations
