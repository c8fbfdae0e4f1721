"""`hoopd learn`: record, diagnose, choose the next run, until it is known; then design, and try old against new.

Rules of this file: the order of the steps, which `learn_steps` does, and when they end; nothing here touches a drive.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import typer

from hoopd.commands.diagnose import judged_model
from hoopd.commands.learn_given import given, next_by_hand, read_through
from hoopd.commands.learn_steps import Progress, Steps, set_aside
from hoopd.commands.options.declaration import option_name
from hoopd.commands.options.learn import LearnOptions, seconds_of
from hoopd.commands.options.shared import ProgressLine, finish, shown_progress
from hoopd.commands.output import check_json
from hoopd.commands.plant_inputs import other_model
from hoopd.commands.step_commands import StepError
from hoopd.files.campaign_progress import LOCK, TAKEN, BelievedRun
from hoopd.files.folder_lock import alone_in
from hoopd.files.json_files import write_json
from hoopd.files.memory import load_memory
from hoopd.files.reading import InputError
from hoopd.files.whole_files import check_target, replace_file
from hoopd.learn.belief import Belief
from hoopd.learn.campaign import (
    Campaign,
    CampaignRequest,
    DiagnosedRun,
    RunFiles,
    lasted_s,
    recorded_try,
)
from hoopd.learn.choice import ChosenRun
from hoopd.plants.hoop.loop.experiment_plan import DURATION_S, DURATIONS_S
from hoopd.plants.model_file import HOOP
from hoopd.shell.config import load as load_config

# Whether this may be played on a device.
MayPlay = Callable[[str], bool]
# What a run takes beside its signal: until everything is well, and braking.
AROUND_S = 2.0
LEAST_S = 5.0  # of a recording that is worth a diagnosis
READ_BY = ("columns", "age", "hold")  # options by which another laboratory's file is read
MOST_SMALLER = 3  # tries of one signal with half the torque of the one before


def learn(options: LearnOptions) -> None:
    """The campaign, its story and its result; exit code 1 when it was not settled."""
    check_json(options.json_path)
    _check(options)
    with shown_progress() as progress:
        try:
            result = run(options, progress, lambda text: _asked_for(text, options, progress))
        except StepError as error:
            raise InputError(options.out, "", str(error)) from None
        except KeyboardInterrupt:
            with progress.hidden():
                typer.echo(f"interrupted: {options.out} keeps what is done, and the same command goes on", err=True)
            raise
    finish(result, options.json_path, {key: value for key, value in result.items() if key != "beliefs"})
    raise typer.Exit(0 if result["settled"] else 1)


def run(
    options: LearnOptions, progress: Progress = lambda text: None, may_play: MayPlay = lambda text: True
) -> dict[str, Any]:
    """The result as plain data; StepError, InputError. `may_play` is asked before a device is driven."""
    campaign, budget_s = Campaign(options.out), seconds_of(options.budget)
    _check_files(options)
    campaign.begin(_asked(options, budget_s))
    with alone_in(options.out, LOCK, TAKEN):
        try:
            return _run(Steps(campaign, options, progress), budget_s, may_play)
        except StepError as error:
            campaign.tell(doing="", asks="", ended=f"Broken off: {error}")
            raise


def _run(steps: Steps, budget_s: float, may_play: MayPlay) -> dict[str, Any]:
    steps.campaign.tell(budget_s=budget_s, confidence=steps.options.confidence, ended="")
    if steps.options.recordings:
        return _given(steps)
    runs, ended = record_until_settled(steps, budget_s, may_play)
    comparison, kept, why = _tried(steps, runs)
    result = _result(runs, ended, comparison, kept, why)
    _tell(steps.campaign, runs, result, comparison)
    return result


def _check(options: LearnOptions) -> None:
    """InputError for what cannot be begun."""
    if options.recordings:
        if options.sim or options.config is not None:
            raise InputError("--recording", "", "what was recorded by hand drives nothing: not with --sim or --config")
        return
    for name in READ_BY:
        if getattr(options, name) != LearnOptions.__dataclass_fields__[name].default:
            raise InputError(
                option_name(LearnOptions, name), "", "only with --recording: what is recorded here is known"
            )
    if options.plant not in (None, HOOP):
        raise InputError("--plant", "", "another plant is not driven from here: --recording FILE for each recording")
    if not options.sim and options.config is None:
        raise InputError("--sim", "", "or --config FILE: where shall be recorded?")


def _check_files(options: LearnOptions) -> None:
    """InputError for files that are not what they should be, before a folder is made or anything is recorded."""
    plant = None if options.plant is None else other_model(options.plant, None)
    if options.recordings:
        read_through(given(options), options)
    elif plant is None:
        load_config(options.config, sim=options.sim, overrides=list(options.sets))
    if options.memory is not None:
        check_target(options.memory, "--memory")
        load_memory(options.memory, None if plant is None else plant.plant.name)


def _asked_for(text: str, options: LearnOptions, progress: ProgressLine) -> bool:
    """Whether a device may be driven: asked on a terminal, unless nothing shall be."""
    if options.sim or options.yes:
        return True
    if not sys.stdin.isatty():
        raise InputError("--yes", "", "nobody is there to be asked before the device is driven")
    with progress.hidden():
        return typer.confirm(f"{text} Play it?", err=True)


def _given(steps: Steps) -> dict[str, Any]:
    """What recordings of another plant say together, and the input that is to be played next, by hand."""
    campaign, options = steps.campaign, steps.options
    runs, now = campaign.runs(options.confidence), given(options)
    if not runs or not runs[-1].choice.is_of_the_same(now):
        files = campaign.run_files(len(runs) + 1)
        campaign.keep(files, *read_through(now, options))
        steps.diagnose(files, options.recordings, len(runs) + 1)
        runs = campaign.runs(options.confidence)
    last = runs[-1]
    told, why = next_by_hand(last, judged_model(options.plant, None).plant, options.plant)
    ended = "Everything that is named is sure and proven." if last.belief.settled else "; ".join(last.belief.open)
    result = _result(runs, ended, None, False, f"{why} Next: {told}." if told else why)
    result |= {"recorded_s": last.seconds, "next": told}
    _tell(campaign, runs, result, None)
    return result


def _asked(options: LearnOptions, budget_s: float) -> CampaignRequest:
    config = None if options.config is None else str(options.config)
    return CampaignRequest(
        budget_s=budget_s, confidence=options.confidence, seed=options.seed, sim=options.sim, config=config,
        sets=options.sets, plant=options.plant, columns=options.columns, age=options.age, hold=options.hold,
    )  # fmt: skip


def record_until_settled(
    steps: Steps, budget_s: float, may_play: MayPlay = lambda text: True, most_runs: int | None = None
) -> tuple[list[DiagnosedRun], str]:
    """Runs until it is settled, nothing more can be learned, or the budget ends; and which of these it was."""
    campaign, confidence = steps.campaign, steps.options.confidence
    while True:
        runs = campaign.runs(confidence)
        _tell_so_far(campaign, runs)
        if runs and runs[-1].belief.settled:
            return runs, f"Everything that is named is {confidence:.0%} sure and proven, and nothing else stands out."
        if len(runs) == most_runs:
            return runs, f"{most_runs} runs were played."
        choice = campaign.choose(runs)
        if choice is None:
            why = "; ".join(runs[-1].belief.open) if runs else "a limit has ended every one too early"
            return runs, f"No signal inside the limits tells more: {why}."
        early = campaign.run_files(len(runs) + 1).early
        spent = sum(one.seconds for one in runs) + sum(lasted_s(path) for path in early)
        if spent + _longest(choice) > budget_s:
            return runs, f"The budget of {budget_s:.0f} s leaves no room for the next run of {_longest(choice):.0f} s."
        question = f"{' '.join(choice.played)}, {_longest(choice):.0f} s: {choice.reason}."
        if not (steps.options.sim or steps.options.yes):
            campaign.tell(doing="waiting for a word", asks=f"whoever began it: may it play {question}")
        if not may_play(question):
            return runs, "The operator wanted no further run."
        _one_run(steps, runs, choice)


def _one_run(steps: Steps, runs: Sequence[DiagnosedRun], choice: ChosenRun) -> None:
    number = len(runs) + 1
    files = steps.campaign.run_files(number)
    steps.set_result_aside()
    steps.record(files, choice, number)
    if lasted_s(files.experiment) < LEAST_S:
        _ask_for_less(steps.campaign, files, choice, number)
        return
    steps.diagnose(files, [*(one.files.recording for one in runs), files.recording], number)


def _ask_for_less(campaign: Campaign, files: RunFiles, choice: ChosenRun, number: int) -> None:
    """The run again at half its torque, where a limit ended it too early; StepError where something else did, or the
    halves are too many. Either way the next call goes on, and the seconds count."""
    told = recorded_try(files.experiment)
    # before anything is decided: a kill in between plays the same again, and counts no half twice
    set_aside(files.recording, "early")
    set_aside(files.experiment, "early")
    lasted = f"lasted {told.ended_at_s or 0.0:.1f} s"
    if told.limit_passed and told.amplitude_nm is not None and choice.halved < MOST_SMALLER:
        reason = f"{choice.reason}; it {lasted} ({told.outcome}): with half the torque"
        smaller = replace(choice, amplitude_nm=told.amplitude_nm / 2.0, halved=choice.halved + 1, reason=reason)
        campaign.decide(files, smaller)
        return
    if told.limit_passed:
        set_aside(files.choice, "given_up")
    goes_on = "goes on with another signal" if told.limit_passed else "plays it again"
    raise StepError(f"run {number} {lasted}: {told.outcome}; the same command {goes_on}")


def _longest(choice: ChosenRun) -> float:
    """Seconds that the run will take."""
    words = choice.words
    told = float(words[words.index("--duration") + 1]) if "--duration" in words else None
    return (DURATIONS_S.get(words[0], DURATION_S) if told is None else told) + AROUND_S


def _tried(steps: Steps, runs: Sequence[DiagnosedRun]) -> tuple[dict[str, Any] | None, bool, str]:
    """The alternating run, whether the new controller is kept, and why."""
    if not runs:
        return None, False, "Nothing was recorded."
    last = runs[-1]
    if last.diagnosis.verdict == "consistent":
        return None, False, "The model stays: there is nothing to design anew."
    steps.design(last.files.model)
    if not steps.options.sim:
        told = f"hoopd compare {_accepted(steps.options)} {steps.campaign.controller}"
        return None, False, f"On a device an alternating run is one armed run beside its daemon: {told}"
    comparison = steps.compare(_accepted(steps.options))
    kept = comparison["verdict"] == "better"
    word = "is kept" if kept else "is left, the old one stays"
    return comparison, kept, f"The new controller {word}: {comparison['reason']}."


def _accepted(options: LearnOptions) -> str:
    from hoopd.shell import config as configuration

    return str(configuration.load(options.config, sim=options.sim, overrides=list(options.sets)).control.file)


def _result(
    runs: Sequence[DiagnosedRun], ended: str, comparison: dict[str, Any] | None, kept: bool, why: str
) -> dict[str, Any]:
    belief: Belief | None = runs[-1].belief if runs else None
    return {
        "settled": bool(belief and belief.settled),
        "explanation": belief.explanation if belief else "nothing was recorded",
        "laws": list(belief.laws) if belief else [],
        "probability": belief.probability if belief else None,
        "unknown": belief.unknown if belief else None,
        "runs": len(runs),
        "recorded_s": sum(one.seconds for one in runs),
        "ended_because": ended,
        "comparison": comparison["verdict"] if comparison else None,
        "kept": kept,
        "kept_because": why,
        "beliefs": [dict(one.belief.shares) for one in runs],
    }


def _tell_so_far(campaign: Campaign, runs: Sequence[DiagnosedRun]) -> None:
    """What is believed until now, as file and page; both are told anew with every run."""
    from hoopd.learn.story import story

    told = [
        BelievedRun(
            signal=" ".join(one.choice.played), why=one.choice.reason, seconds=one.seconds,
            explanation=one.belief.explanation, sure=one.belief.probability, open=list(one.belief.open),
        )
        for one in runs
    ]  # fmt: skip
    campaign.tell(runs=told)
    if runs:
        replace_file(campaign.story, story(runs, _result(runs, "It goes on.", None, False, ""), None))


def _tell(
    campaign: Campaign, runs: Sequence[DiagnosedRun], result: dict[str, Any], comparison: dict[str, Any] | None
) -> None:
    from hoopd.learn.story import story

    result |= {"story": str(campaign.story), "model": str(runs[-1].files.model) if runs else None}
    if runs:
        replace_file(campaign.story, story(runs, result, comparison))
    write_json(campaign.result, result)
    campaign.tell(doing="", asks="", ended=f"{result['ended_because']} {result['kept_because']}")
