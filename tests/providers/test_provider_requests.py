"""What each provider's class of model is sent, in the words and numbers of its rules."""

import pytest
from families import FAMILIES, Family, asking
from vlm_cases import simulated

pytestmark = pytest.mark.system  # where all clients are installed


@pytest.mark.parametrize("family", FAMILIES, ids=str)
def test_a_judgement_and_a_recovery_are_asked_for_within_the_providers_rules(
    family: Family,
) -> None:
    with asking(family) as (server, mind):
        verdict = mind.judge(simulated().judged[-1])
        recovery = mind.recover(*simulated().recovered[0])
    assert server.refused == []
    assert (verdict.by, verdict.fallback) == ("vlm", "")
    assert recovery is not None
    assert (recovery.by, recovery.fallback) == ("vlm", "")
    assert [len(asked.pictures) for asked in server.asked] == [2, 1, 1]
