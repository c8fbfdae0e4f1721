"""Who may look and who may command: users, access rules, and settings that are refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest
import zenoh
from shell.peers import Ticks, client, controlled, receive, running, tick, wait_until

from hoopd.core.records import Command
from hoopd.files.reading import InputError
from hoopd.shell.commands import Gate, Ranges
from hoopd.shell.operator import CommandError
from hoopd.shell.remote import send
from hoopd.shell.telemetry import Telemetry, TelemetrySettings

WATCHING = ["put", "declare_subscriber", "liveliness_token", "declare_liveliness_subscriber", "liveliness_query"]

ACCESS = {
    "enabled": True,
    "default_permission": "deny",
    "rules": [
        {
            "id": "watch",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": WATCHING,
            "key_exprs": ["hoopd/**"],
        },
        {
            "id": "command",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": ["query", "reply", "declare_queryable"],
            "key_exprs": ["hoopd/*/cmd/*"],
        },
    ],
    "subjects": [{"id": "all", "usernames": ["viewer", "operator"]}, {"id": "operators", "usernames": ["operator"]}],
    "policies": [{"rules": ["watch"], "subjects": ["all"]}, {"rules": ["command"], "subjects": ["operators"]}],
}


def who(user: str, password: str) -> dict[str, Any]:
    """zenoh's keys of a client that says who it is."""
    return {"transport/auth/usrpwd/user": user, "transport/auth/usrpwd/password": password}


def test_users_and_access_rules(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    proof = {**settings.control_zenoh, "access_control": ACCESS}
    settings = dataclasses.replace(settings, zenoh=proof, control_zenoh=proof)
    control = settings.control_endpoint
    with running(settings) as telemetry, Ticks(telemetry.gate) as ticks:
        with pytest.raises(CommandError, match=r"does not let us in|no daemon answers"):
            send("arm", endpoint=control, timeout_s=1.0)
        with pytest.raises(CommandError, match=r"does not let us in|no daemon answers"):
            send("arm", endpoint=control, timeout_s=1.0, extras=who("operator", "wrong"))
        with pytest.raises(CommandError, match="access rules"):
            send("arm", endpoint=control, timeout_s=1.0, extras=who("viewer", "look"))
        assert ticks.take() == ()
        send("arm", endpoint=control, extras=who("operator", "turn"))
        assert ticks.take() == (Command("arm"),)
        with client(settings.endpoint, **who("viewer", "look")) as session:
            rows = session.declare_subscriber("hoopd/hoop/tick", zenoh.handlers.RingChannel(10))
            assert wait_until(lambda: telemetry._publishers["tick"].matching_status.matching)
            telemetry.put(tick(1))
            assert len(receive(rows, 1)) == 1


MUTUAL = {"transport": {"link": {"tls": {"enable_mtls": True}}}}
HERE = "tcp/127.0.0.1:7448"


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (TelemetrySettings(zenoh={"scouting/typo": 1}), r"telemetry\.zenoh\.scouting/typo: zenoh refuses it"),
        (
            TelemetrySettings(endpoint="foo"),
            r"telemetry\.endpoint: 'foo': expected something like tcp/127\.0\.0\.1:7447",
        ),
        (TelemetrySettings(endpoint="tcp/127.0.0.1:99999"), r"telemetry\.endpoint"),
        (TelemetrySettings(device="a/b"), r"device\.name: 'a/b'"),
        (TelemetrySettings(commands=True), r"telemetry\.commands: needs telemetry\.control with an endpoint and users"),
        (TelemetrySettings(commands=True, control_endpoint="bogus"), r"telemetry\.control\.endpoint: 'bogus'"),
        (
            TelemetrySettings(commands=True, control_endpoint=HERE, control_zenoh={"typo": 1}),
            r"telemetry\.control\.zenoh\.typo: zenoh refuses it",
        ),
        (
            TelemetrySettings(commands=True, control_endpoint=HERE),
            r"telemetry\.control\.zenoh: lets in who does not say",
        ),
        # a certificate is shown on a link of TLS only
        (TelemetrySettings(commands=True, control_endpoint=HERE, control_zenoh=MUTUAL), "lets in who does not say"),
        (
            TelemetrySettings(
                commands=True,
                control_endpoint="tls/127.0.0.1:7448",
                control_zenoh={**MUTUAL, "listen/endpoints": ["tls/[::1]:7448", HERE]},
            ),
            "lets in who does not say",
        ),
    ],
)
def test_unsafe_settings_are_refused_before_anything_opens(settings: TelemetrySettings, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Telemetry(settings, Gate(Ranges()))


def test_a_file_without_users_lets_everybody_in_and_is_refused(tmp_path: Path) -> None:
    nobody = tmp_path / "users.txt"
    nobody.write_text("\n")
    proof = {"transport/auth/usrpwd/dictionary_file": str(nobody)}
    with pytest.raises(InputError, match="lets in who does not say"):
        Telemetry(TelemetrySettings(commands=True, control_endpoint=HERE, control_zenoh=proof), Gate(Ranges()))
