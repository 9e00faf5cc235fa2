"""Sentences that people read are plain: at most 25 words, and the words of the field."""

import re

from baqueano.messages import templates

WORDS = 25  # of a sentence; a figure counts as one
NEGATION = re.compile(r"\b(is|are|was|were|has|have|had) (no|none|neither|nobody)\b(?! longer| more| effect)")
SAYING = re.compile(r"\b(told|foretells?|coloured|whoever|whatever|cannot be (told|seen))\b")


def test_a_message_is_plain():
    for code, template in templates().items():
        bare = re.sub(r"\{[^{}]*\}", "x", template)
        long = [one for one in re.split(r"[.;:!?] ", bare) if len(one.split()) > WORDS]
        assert not long, f"{code}: over {WORDS} words: {long}"
        assert not NEGATION.search(bare), f'{code}: say "is not a", "does not exist": {template}'
        assert not SAYING.search(bare), (
            f"{code}: a term of the field, in place of a verb of saying: {template}"
        )
