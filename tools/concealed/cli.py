"""Command line of the proof: hidden effects, sealed answers, and what `hoopd diagnose` says.

python tools/concealed [--singles 5] [--nulls 60] [--full] [--tuning [SEED]] [--resume DIR [--retry]]    a scored run
python tools/concealed --family left_out                      effects that the library of who is asked is made to lack
python tools/concealed --family outside [--library-only]      physics that no library has, with names alone
python tools/concealed calibrate [--nulls 60] [--tuning SEED] [--resume DIR]                  threshold, tuning seeds
python tools/concealed generate DIR --family single,null --per-effect 1 --seed N               cases and answers
python tools/concealed report DIR                                                              figures of a run so far
python tools/concealed reliability DIR                                                   whether probabilities are kept
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn

from rich.console import Console

from concealed.effects import ALL
from concealed.families import FAMILIES, OUTSIDE_NATS, USUAL
from concealed.runfolder import Asked, FolderError, RunFolder
from concealed.seeds import is_tuning, score_seed

console = Console(stderr=True)
# A stratified run ends below two hours on two cores; the full one is the same command.
STRATIFIED = {
    "singles": 5,
    "nulls": 60,
    "decoys": 12,
    "confounded": 12,
    "compounds": 20,
    "unknown": 21,
    "left_out": 1,
    "outside": 4,
}
CALIBRATING = {
    "singles": 1,
    "nulls": 60,
    "decoys": 12,
    "confounded": 0,
    "compounds": 0,
    "unknown": 0,
    "left_out": 0,
    "outside": 0,
}
FULL = {
    "singles": 20,
    "nulls": 100,
    "decoys": 30,
    "confounded": 36,
    "compounds": 60,
    "unknown": 70,
    "left_out": 3,
    "outside": 12,
}


def generate(options: argparse.Namespace) -> None:
    """Writes DIR/cases and DIR/answers."""
    from concealed import cases

    wanted, start = asked(options, options.seed).wishes(), time.perf_counter()
    console.print(f"{len(wanted)} cases, seed {options.seed}")
    made = cases.make(
        wanted, options.seed, say=lambda text: console.print(f"{time.perf_counter() - start:6.1f} s  {text}")
    )
    cases.write(made, options.dir / "cases", options.dir / "answers")


def score(options: argparse.Namespace) -> None:
    """A run from the beginning, or one that goes on."""
    from concealed.score import cluster, publish, run

    folder = RunFolder(options.resume or options.out or Path(f"build/concealed-{time.strftime('%Y%m%d-%H%M%S')}"))
    if not options.resume:
        seed = score_seed() if options.tuning is None else options.tuning
        folder.start(asked(options, seed))
    folder.asked()  # before any worker is started
    with cluster(options.scheduler, options.workers) as client:
        run(folder, client, console, retry=options.retry)
    publish(folder, Console())


def calibrate(options: argparse.Namespace) -> None:
    """How surprising nulls of a tuning seed get."""
    from concealed.score import cluster, publish_calibration, run

    folder = RunFolder(options.resume or options.out or Path(f"build/calibration-{time.strftime('%Y%m%d-%H%M%S')}"))
    if not options.resume:
        folder.start(asked(options, options.tuning))
    folder.asked()
    with cluster(options.scheduler, options.workers) as client:
        run(folder, client, console, rivals=False)
    publish_calibration(folder, Console())


def report(options: argparse.Namespace) -> None:
    """The figures of a run's folder."""
    from concealed.score import publish

    publish(RunFolder(options.dir), Console())


def reliability(options: argparse.Namespace) -> None:
    """Of the answers and diagnoses of a folder; diagnoses may be JSON of `hoopd diagnose` as it is."""
    from concealed.judged import Judged
    from concealed.reliability import markdown, reliability

    folder = RunFolder(options.dir)
    told = [(folder.answer(name), folder.said("diagnoses", name)) for name in folder.identifiers()]
    cases = [Judged(answer, said.get("diagnosis", said)) for answer, said in told if said is not None]
    if not cases:
        raise FolderError(f"{options.dir}: no answers with diagnoses in this folder")
    Console().print(markdown(reliability(cases)), markup=False, highlight=False, soft_wrap=True)


def asked(options: argparse.Namespace, seed: int) -> Asked:
    """The counts of each family."""
    usual = FULL if options.full else options.usual
    counts = {name: getattr(options, name) if getattr(options, name) is not None else usual[name] for name in usual}
    families = tuple(options.family.split(","))
    if unknown := set(families) - set(FAMILIES):
        refuse(f"no family {', '.join(sorted(unknown))}; known: {', '.join(FAMILIES)}")
    if strange := set(options.only) - set(ALL):
        refuse(f"no effect {', '.join(sorted(strange))}")
    library_only = getattr(options, "library_only", False)
    return Asked(
        seed=seed, families=families, only=options.only, library_only=library_only, outside_nats=options.outside_nats,
        **counts,
    )  # fmt: skip


def refuse(reason: str) -> NoReturn:
    """Ends with one line and code 2: what was typed cannot be done."""
    print(f"concealed: {reason}", file=sys.stderr)
    raise SystemExit(2)


def _counts(parser: argparse.ArgumentParser, family: str, usual: Mapping[str, int] = STRATIFIED) -> None:
    parser.set_defaults(usual=usual)
    parser.add_argument("--family", default=family, help=f"comma-separated: {', '.join(FAMILIES)}")
    parser.add_argument("--full", action="store_true", help="20 cases an effect, 100 nulls")
    parser.add_argument("--singles", "--per-effect", type=int, help="cases an effect")
    for name in ("nulls", "decoys", "confounded", "compounds", "unknown"):
        parser.add_argument(f"--{name}", type=int, help="cases")
    parser.add_argument("--left-out", type=int, help="cases an effect of --family left_out: the library lacks it")
    parser.add_argument("--outside", type=int, help="cases a kind of --family outside: physics that no library has")
    parser.add_argument(
        "--outside-nats", type=_range, default=OUTSIDE_NATS, metavar="LOW:HIGH", help="their sizes in nats (5:400)"
    )
    parser.add_argument("--only", type=_names, default=(), help="comma-separated effects; cases without effects stay")


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split(","))


def _range(text: str) -> tuple[float, float]:
    low, high = (float(one) for one in text.split(":"))
    if not 1.0 <= low < high / 2.0 < float("inf"):
        raise argparse.ArgumentTypeError(f"{text}: LOW:HIGH in nats, LOW at least 1 and HIGH more than twice as much")
    return low, high


def _tuning_seed(text: str) -> int:
    seed = int(text)
    if not is_tuning(seed):
        raise argparse.ArgumentTypeError("score seeds are drawn, not given")
    return seed


def _scored() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="concealed", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    _counts(parser, ",".join(USUAL))
    parser.add_argument("--tuning", type=_tuning_seed, nargs="?", const=1, help="a tuning seed instead of a drawn one")
    _running(parser)
    parser.set_defaults(run=score)
    return parser


def _calibrating() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="concealed calibrate", description="How surprising chance is.")
    _counts(parser, "single,null,decoy", CALIBRATING)
    parser.add_argument("--tuning", type=_tuning_seed, default=1, help="a tuning seed")
    _running(parser)
    parser.set_defaults(run=calibrate)
    return parser


def _running(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scheduler", help="address of a dask scheduler; without it this machine's cores")
    parser.add_argument("--workers", type=int, default=2, help="processes on this machine")
    parser.add_argument("--out", type=Path, help="folder of the run (build/concealed-DATE)")
    parser.add_argument("--resume", type=Path, help="folder of a run that was broken off")
    parser.add_argument("--retry", action="store_true", help="ask again for diagnoses that failed")
    parser.add_argument("--library-only", action="store_true", help="have cases diagnosed without the grammar")


def _generating() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="concealed generate", description="Write cases and their answers.")
    parser.add_argument("dir", type=Path)
    _counts(parser, "single,null")
    parser.add_argument("--seed", type=_tuning_seed, default=1)
    parser.set_defaults(run=generate)
    return parser


def _reporting() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="concealed report", description="Figures of a run so far.")
    parser.add_argument("dir", type=Path)
    parser.set_defaults(run=report)
    return parser


def _keeping() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="concealed reliability", description="Whether probabilities are kept.")
    parser.add_argument("dir", type=Path)
    parser.set_defaults(run=reliability)
    return parser


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    parsers = {
        "generate": _generating, "report": _reporting, "calibrate": _calibrating, "reliability": _keeping
    }  # fmt: skip
    parser = parsers[words.pop(0)]() if words and words[0] in parsers else _scored()
    options = parser.parse_args(words)
    try:
        options.run(options)
    except FolderError as error:
        refuse(str(error))
