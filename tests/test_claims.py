"""Every published number is reproduced, refuted or named as not derivable: data/README.md says what comes out today."""

from dataclasses import replace

from tests import claims


def test_the_table_of_claims_is_what_comes_out_here():
    text = claims.README.read_text(encoding="utf-8")
    assert claims.HEADING in text, "run python tests/claims.py"
    written = claims.HEADING + text.split(claims.HEADING)[1]
    assert written == claims.section(), "run python tests/claims.py"


def test_verdicts_are_computed():
    claim = claims.Claim("here", "a number", 5, "ms", lambda: 5.2, 0.1, "how")
    assert claim.row() == ("refuted", "| here | a number | 5 ms | 5.2 ms | refuted | how |")
    assert replace(claim, tolerance=0.3).row()[0] == "reproduced"
    assert replace(claim, found=None).row() == ("not derivable", "| here | a number | 5 ms | – | not derivable | how |")
