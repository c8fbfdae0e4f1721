"""Whether readings are late beside everything that was found, whatever that is.

A search ends when it has as many names as it may have, and after the grammar's turn it does not ask the library again.
What is late is wrong in proportion to its rate: the innovations of the final fit are held against what each sensor's
age would change of them, through the fit's own filter and freed of all that is fitted (the cross-correlation at every
lag that the filter remembers), as in any screen.

Rules of this file: it asks and says; nothing is named here, for folds and held-out data have not been heard.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from hoopd.diagnose.search.candidates import needed_of, surprise_of
from hoopd.diagnose.search.naming import Named
from hoopd.diagnose.search.screen import Screen
from hoopd.plants.effects.base import Effect


def late_sentences(named: Named, library: Mapping[str, Effect], threshold: float) -> list[str]:
    """Of every sensor whose readings still ask for an age, beyond what names an effect.

    Parameters
    ----------
    named
        What was found.
    library
        Effects that may be asked for.
    threshold
        Nats of surprise from which on an effect is named.
    """
    return [*_late(named, library, threshold)]


def _late(named: Named, library: Mapping[str, Effect], threshold: float) -> Iterator[str]:
    stretches = [track.stretch for track in named.final.tracks]
    told = {*named.final.names, *named.refusals}
    asked = [one for name, one in library.items() if one.latency and name not in told]
    for score in Screen(named.final, asked).scores() if asked else ():
        if surprise_of(score, score.gain, stretches) < threshold:
            continue
        effect, channels = score.member.effect, ", ".join(score.member.effect.latency)
        age_ms = 1e3 * score.start[effect.key(next(iter(effect.latency.values())))]
        needed = needed_of(score, threshold, stretches)
        yield (
            f"beside all that was found {channels} still looks late, by {age_ms:.2g} ms to first order "
            f"({score.gain:.0f} nats, {needed:.0f} needed): are the ages of the samples right (--age)?"
        )
