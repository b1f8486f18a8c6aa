"""Rules of `gateway.link.others.gateway_token`: what is written is read back, and nothing else is taken for a gateway."""

from __future__ import annotations

import pytest
import zenoh

from gateway.link.others.gateway_token import GatewayToken, format_gateway_token, gateway_tokens, parse_gateway_token


@pytest.mark.parametrize("namespace", ["", "bot1", "/lab/bot1/"])
@pytest.mark.parametrize("is_armed", [False, True])
def test_a_token_is_read_back_and_seen_by_who_follows_all(namespace, is_armed):
    """With the namespace of its robot; the wildcard of the access list includes it, too."""
    key = format_gateway_token("ab12", namespace, is_armed=is_armed)
    assert parse_gateway_token(key, namespace) == GatewayToken("ab12", is_armed)
    assert zenoh.KeyExpr(gateway_tokens(namespace)).includes(key)
    rule = format_gateway_token("*", namespace, is_armed=is_armed)
    assert zenoh.KeyExpr(rule).includes(key)
    assert not zenoh.KeyExpr(rule).includes(format_gateway_token("ab12", namespace, is_armed=not is_armed))


def test_the_tokens_have_the_names_that_others_know():
    """Another release of this gateway must see them: they never change."""
    assert format_gateway_token("ab", "", is_armed=False) == "teleavatar_gateway/ab"
    assert format_gateway_token("ab", "bot1", is_armed=True) == "bot1/teleavatar_gateway/ab/armed"


@pytest.mark.parametrize(
    "key",
    [
        "teleavatar_gateway/",
        "teleavatar_gateway/AB",
        "teleavatar_gateway/zz",
        "teleavatar_gateway/ab/",
        "teleavatar_gateway/ab/idle",
        "teleavatar_gateway/ab/armed/more",
        "bot1/teleavatar_gateway/ab",
        "left_arm/joint_states",
        f"teleavatar_gateway/{'a' * 33}",
    ],
)
def test_what_is_no_token_of_a_gateway_is_ignored(key):
    """No zenoh id, another word, another namespace."""
    assert parse_gateway_token(key, "") is None
