"""English without text: its words are guessed, and their phones lie where they sound."""

import pytest
import soundfile

from encoder.capture.made import phone_labels
from encoder.capture.speech.synthesis import speak_flite
from encoder.capture.subjects.real import TranscriptLine, envelope_takes

pytestmark = pytest.mark.slow
TEXT = "What if she did not come to the rock?"


def test_what_an_unknown_voice_says_is_guessed(tmp_path):
    made = speak_flite(TEXT, "rms")
    soundfile.write(tmp_path / "a.wav", made.audio, 48_000)
    line = TranscriptLine("a.wav", "en", "anna", "")
    (known,) = envelope_takes(tmp_path, [line], (0,))
    true = phone_labels(made.phones, known.clip.num_frames)
    spoken = true > 0
    assert (known.clip.phones == true)[spoken].mean() > 0.6
    assert known.clip.truth == "envelope"
    (other,) = envelope_takes(tmp_path, [TranscriptLine("a.wav", "sv", "anna", "")], (0,))
    assert (other.clip.phones == -1).all()
