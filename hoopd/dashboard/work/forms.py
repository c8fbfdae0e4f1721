"""What may be asked of a job: the bench's commands, each with the fields that the page offers, as words of a command.

Rules of this file: every word of a command is made here, from a list, a number or a checked text; a value always stands
behind its option (`--option=value`), so that none is taken for an option itself.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec

from hoopd.files.reading import InputError
from hoopd.recording.recording import HOLDS

RECORDINGS = 20  # of one job
RESULT, FIGURE, MODEL, REPORT, CONTROLLER = "result.json", "figure.svg", "model.yaml", "report.html", "controller.yaml"
LARGEST = 1e6
_TEXTS = {
    "plant": re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}"),
    "columns": re.compile(r"[A-Za-z0-9_ =:,.()/*^+-]{1,400}"),
    "orders": re.compile(r"\d{1,2}(,\d{1,2}){1,2}"),
    "names": re.compile(r"[A-Za-z0-9_.]{1,60}(,[A-Za-z0-9_.]{1,60}){0,19}"),
}


@dataclass(frozen=True, kw_only=True)
class FormField:
    """One thing that a form asks for."""

    option: str
    label: str
    kind: str = "choice"  # or number, model, identified, flag, or the name of a text
    choices: tuple[str, ...] = ()
    unit: str = ""
    usual: str = ""  # what the page proposes


@dataclass(frozen=True, kw_only=True)
class Form:
    """One command."""

    meaning: str
    recordings: bool = True  # what it works on
    holdout: bool = False
    recording_option: str = ""  # what stands before the only recording; without it several, as words of their own
    writes: Mapping[str, str]  # file by option
    fields: tuple[FormField, ...] = ()
    law: bool = False  # its first word


class JobOrder(msgspec.Struct, forbid_unknown_fields=True):
    """What somebody asks for."""

    kind: str
    recordings: list[str] = []
    holdout: list[str] = []
    fields: dict[str, str] = {}


ACTING_MODEL = "models/hoop.yaml"  # of the shipped controllers
PLANT = (
    FormField(option="--plant", label="Plant, if not the hoop", kind="plant"),
    FormField(option="--columns", label="Columns, if not the usual ones", kind="columns"),
    FormField(option="--hold", label="Inputs between rows", choices=HOLDS),
)
START = FormField(option="--model", label="Model to start from", kind="model")
LAWS = ("lqg", "lqr", "placement", "pid", "pi", "identified")
FORMS: Mapping[str, Form] = {
    "fit": Form(
        meaning="Fit the plant's parameters, with intervals.",
        holdout=True,
        writes={"--out": MODEL, "--figure": FIGURE, "--json": RESULT},
        fields=(
            FormField(option="--structure", label="Parameters", choices=("entries", "rolling", "published")),
            FormField(option="--method", label="Method", choices=("output", "prediction")),
            START,
            *PLANT,
        ),
    ),
    "diagnose": Form(
        meaning="Say where model and recordings differ, and name the physics that is missing.",
        holdout=True,
        writes={"--report": REPORT, "--write": MODEL, "--json": RESULT},
        fields=(
            FormField(option="--model", label="Model that is judged", kind="model", usual=ACTING_MODEL),
            FormField(option="--yes", label="A doubtful model (see output)", kind="flag", choices=("write it, too",)),
            FormField(option="--without", label="Effects not to look for", kind="names"),
            *PLANT,
        ),
    ),
    "identify": Form(
        meaning="Identify a linear model.",
        holdout=True,
        writes={"--out": MODEL, "--figure": FIGURE, "--json": RESULT},
        fields=(
            FormField(option="--method", label="Method", choices=("arx", "armax", "oe", "bj", "subspace", "pem")),
            FormField(option="--orders", label="Orders of polynomials", kind="orders"),
            FormField(option="--order", label="States", kind="whole"),
            FormField(option="--outputs", label="Outputs", kind="names"),
            *PLANT,
        ),
    ),
    "calibrate": Form(
        meaning="Signs, torque and camera delay of a recorded test signal.",
        recording_option="--moving",
        writes={"--figure": FIGURE, "--json": RESULT},
        fields=(FormField(option="--model", label="Model in force", kind="model"),),
    ),
    "design": Form(
        meaning="Design a controller for a model.",
        recordings=False,
        law=True,
        writes={"--out": CONTROLLER, "--figure": FIGURE, "--json": RESULT},
        fields=(
            FormField(option="--model", label="Model", kind="model", usual=ACTING_MODEL),
            FormField(option="--identified", label="identified: its model", kind="identified"),
            FormField(option="--mt", label="pid: largest |T|", kind="number"),
            FormField(option="--phase", label="pi: phase margin; pid: touching point", kind="number", unit="deg"),
            FormField(option="--bandwidth", label="Where the loop is shaped", kind="number", unit="rad/s"),
            FormField(option="--delay", label="Age of a picture", kind="number", unit="s"),
        ),
    ),
}  # fmt: skip


def told() -> dict[str, Any]:
    """The forms as the page draws them."""
    return {
        name: {
            "meaning": form.meaning,
            "recordings": form.recordings,
            "holdout": form.holdout,
            "laws": LAWS if form.law else (),
            "fields": [asdict(one) for one in form.fields],
        }
        for name, form in FORMS.items()
    }


def words(order: JobOrder, recording: Callable[[str], Path], model: Callable[[str], str]) -> list[str]:
    """The command behind `hoopd`; InputError for what no form offers.

    recording, model: from a name to what the command is given; InputError for one that there is not.
    """
    form = FORMS.get(order.kind)
    if form is None:
        raise InputError("job", order.kind[:40], f"unknown; known: {', '.join(FORMS)}")
    fields = dict(order.fields)
    line = [order.kind]
    if form.law:
        line.append(_one_of("law", fields.pop("law", ""), LAWS))
    line += _recordings(form, order, recording)
    offered = {field.option.lstrip("-"): field for field in form.fields}
    for name, value in fields.items():
        if name not in offered:
            raise InputError(order.kind, name[:40], f"unknown; known: {', '.join(offered)}")
        if value and offered[name].kind == "flag":
            _one_of(name, value, offered[name].choices)
            line.append(offered[name].option)
        elif value:
            line.append(f"{offered[name].option}={_value(offered[name], value, model)}")
    return line + [f"{option}={file}" for option, file in form.writes.items()]


def _recordings(form: Form, order: JobOrder, recording: Callable[[str], Path]) -> list[str]:
    if len(order.recordings) + len(order.holdout) > RECORDINGS:
        raise InputError(order.kind, "recordings", f"at most {RECORDINGS}")
    if order.holdout and not form.holdout:
        raise InputError(order.kind, "holdout", "takes none")
    if form.recordings and not order.recordings:
        raise InputError(order.kind, "recordings", "choose one at least")
    if not form.recordings and (order.recordings or order.holdout):
        raise InputError(order.kind, "recordings", "takes none")
    if both := sorted({*order.recordings} & {*order.holdout}):
        raise InputError(order.kind, "holdout", f"{both[0]} cannot judge what it was fitted to")
    if form.recording_option and len(order.recordings) > 1:
        raise InputError(order.kind, "recordings", "takes one")
    before = f"{form.recording_option}=" if form.recording_option else ""
    used = [f"{before}{recording(name)}" for name in order.recordings]
    return used + [f"--holdout={recording(name)}" for name in order.holdout]


def _value(field: FormField, value: str, model: Callable[[str], str]) -> str:
    name = field.option.lstrip("-")
    if field.kind == "choice":
        return _one_of(name, value, field.choices)
    if field.kind in ("model", "identified"):
        return model(value)
    if field.kind in ("number", "whole"):
        return _number(name, value, whole=field.kind == "whole")
    if not _TEXTS[field.kind].fullmatch(value):
        raise InputError(name, value[:40], "not what is expected here")
    return value


def _one_of(name: str, value: str, known: tuple[str, ...]) -> str:
    if value not in known:
        raise InputError(name, value[:40], f"unknown; known: {', '.join(known)}")
    return value


def _number(name: str, value: str, *, whole: bool) -> str:
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not abs(number) <= LARGEST or (whole and not (number.is_integer() and number > 0)):
        raise InputError(name, value[:40], f"expected a {'whole ' if whole else ''}number")
    return str(int(number)) if whole else repr(number)
