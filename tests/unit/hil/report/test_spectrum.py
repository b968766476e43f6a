"""Yaw spectra of signals with known spectra."""

import numpy as np
import pytest

from hil.report import field_log, spectrum
from hil.report.spectrum import density, log_spectra
from support.paths import REPLAY

STEP_S = 0.1


def test_density_of_a_sine_has_its_frequency_and_power():
    time_s = np.arange(20_000) * STEP_S
    psd = density(3.0 * np.sin(2.0 * np.pi * 0.4 * time_s), 2000, STEP_S)
    hertz = np.fft.rfftfreq(2000, STEP_S)
    assert hertz[np.argmax(psd)] == pytest.approx(0.4, abs=hertz[1])
    assert np.sum(psd) * hertz[1] == pytest.approx(4.5, rel=0.01)


def test_density_of_white_noise_is_constant():
    psd = density(2.0 * np.random.default_rng(1).standard_normal(100_000), 2000, STEP_S)
    assert np.mean(psd) / (2.0 * STEP_S) == pytest.approx(4.0, rel=0.05)


def test_linear_trend_is_removed():
    assert density(np.linspace(0.0, 300.0, 2000), 2000, STEP_S).max() < 1e-15


def test_wave_yaw_is_in_the_spectrum_of_the_estimated_waves():
    log = field_log.read([REPLAY / "tank_pni_volz.BIN"])
    spectra = log_spectra(log)
    assert [label for label, _, _ in spectra["lines"]] == ["compass", "waves (estimated)", "heading (estimated)"]
    lines = {label: np.array(values) for label, _, values in spectra["lines"]}
    hertz = np.array(spectra["frequency_hz"])
    assert all(values.size == hertz.size for values in lines.values())
    waves = (hertz > 0.3) & (hertz < 0.6)
    assert lines["waves (estimated)"][waves].sum() > 5.0 * lines["heading (estimated)"][waves].sum()
    (mark_hz, label), *others = spectra["marks"]
    assert not others
    assert mark_hz == pytest.approx(1.0 / 2.53, rel=0.2)
    assert label.startswith("filter: 2.")


def test_short_log_has_no_spectrum(monkeypatch):
    monkeypatch.setattr(spectrum, "_MIN_SEGMENT_S", 1e6)
    assert log_spectra(field_log.read([REPLAY / "tank_pni_volz.BIN"])) is None
