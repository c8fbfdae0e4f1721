"""Who may look and who may command: users, access rules, and settings that are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import zenoh
from shell.peers import client, free_endpoint, receive, running, tick, wait_until

from hoopd.core.records import Command
from hoopd.files import InputError
from hoopd.shell.commands import Gate, Ranges
from hoopd.shell.operator import CommandError
from hoopd.shell.remote import send
from hoopd.shell.telemetry import Settings, Telemetry


def users(folder: Path) -> Path:
    """zenoh's own file of users."""
    path = folder / "users.txt"
    path.write_text("viewer:look\noperator:turn\n", encoding="utf-8")
    return path


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
    endpoint = free_endpoint()
    extras = {
        "transport": {"auth": {"usrpwd": {"user": "hoop", "password": "x", "dictionary_file": str(users(tmp_path))}}},
        "access_control": ACCESS,
    }
    with running(Settings(endpoint=endpoint, commands=True, zenoh=extras)) as telemetry:
        with pytest.raises(CommandError, match=r"does not let us in|no daemon answers"):
            send("arm", endpoint=endpoint, timeout_s=1.0)
        with pytest.raises(CommandError, match=r"does not let us in|no daemon answers"):
            send("arm", endpoint=endpoint, timeout_s=1.0, extras=who("operator", "wrong"))
        with pytest.raises(CommandError, match="access rules"):
            send("arm", endpoint=endpoint, timeout_s=1.0, extras=who("viewer", "look"))
        assert telemetry.gate.take() == ()
        send("arm", endpoint=endpoint, extras=who("operator", "turn"))
        assert telemetry.gate.take() == (Command("arm"),)
        with client(endpoint, **who("viewer", "look")) as session:
            rows = session.declare_subscriber("hoopd/hoop/tick", zenoh.handlers.RingChannel(10))
            assert wait_until(lambda: telemetry._publishers["tick"].matching_status.matching)
            telemetry.put(tick(1))
            assert len(receive(rows, 1)) == 1


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (Settings(zenoh={"scouting/typo": 1}), r"telemetry\.zenoh\.scouting/typo: zenoh refuses it"),
        (Settings(endpoint="foo"), r"telemetry\.endpoint: 'foo': expected something like tcp/127\.0\.0\.1:7447"),
        (Settings(endpoint="tcp/127.0.0.1:99999"), r"telemetry\.endpoint"),
        (Settings(device="a/b"), r"device\.name: 'a/b'"),
        (
            Settings(endpoint="tcp/0.0.0.0:7447", commands=True),
            r"telemetry\.commands: tcp/0\.0\.0\.0:7447 is open to other",
        ),
        (Settings(commands=True, zenoh={"listen/endpoints": ["tls/[::]:7447"]}), "is open to other machines"),
    ],
)
def test_unsafe_settings_are_refused_before_anything_opens(settings: Settings, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Telemetry(settings, Gate(Ranges()))
