"""Options of verification and of what follows it: those that make no sense are refused when they are made."""

from typing import Any

import pytest

from trihedral.errors import OptionError
from trihedral.pair.preview import PreviewOptions
from trihedral.verdict.appearance import AppearanceOptions
from trihedral.verdict.evidence import EvidenceOptions
from trihedral.verdict.verification import Round, VerificationOptions

ROUND: dict[str, Any] = {
    "keep": 3, "offset": 0.3, "margin": 0.3, "compared": 100, "leniencies": (1,), "prices": (),
    "correspondence_distances": (0.2,), "refined": 100,
}  # fmt: skip


@pytest.mark.parametrize(
    ("options", "wrong"),
    [
        (AppearanceOptions, {"partly_held": 1.5}),
        (AppearanceOptions, {"similarity_a_share": -0.1}),
        (EvidenceOptions, {"offset": 0.0}),
        (EvidenceOptions, {"samples": 0}),
        (VerificationOptions, {"hypotheses": 0}),
        (VerificationOptions, {"distinct_translation": 0.0}),
        (VerificationOptions, {"rival_score": 1.1}),
        (PreviewOptions, {"samples": 0}),
        (Round, ROUND | {"correspondence_distances": ()}),
        (Round, ROUND | {"keep": 0}),
        (Round, ROUND | {"leniencies": (0,)}),
    ],
)
def test_options_that_make_no_sense_are_refused(options: type, wrong: dict[str, Any]) -> None:
    with pytest.raises(OptionError):
        options(**wrong)
    options(**(ROUND if options is Round else {}))
