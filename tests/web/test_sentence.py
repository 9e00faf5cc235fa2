"""The sentences about a vehicle and a recording, without a page."""

import math
from types import SimpleNamespace

from baqueano.diagnostics import note
from baqueano.messages import text
from baqueano.messages.language import use_language
from baqueano.web.sentence import state_message


def test_a_vehicle_at_rest_has_no_negative_speed():
    feed = SimpleNamespace(value=lambda name: -0.001, mean=lambda name, window_s: (math.nan, 0))
    state = state_message({"state": "MANUAL", "mission": "drive"}, feed, None, [])
    assert "0.00 m/s" in state["sentence"]
    assert "-" not in state["sentence"]


def test_the_kind_of_a_recording_is_in_the_language_of_the_reader():
    with use_language("es"):
        assert "(experimento)" in text(note("web.recorded", kind="experiment", seconds=1.0, events=0))
