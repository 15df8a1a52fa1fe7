"""Iron of the robot: found on an ellipse, learnt while driving, and what that is worth."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.sensors.compass import Compass
from agribot.autonomy.estimate.sensors.mag_fit import PER_SECTOR, MagFit, MagFitted
from agribot.core.config import EstimateConfig
from agribot.core.messages import FloatArray
from tests import nightly
from tests.autonomy.estimate.noisy_rover import M8N, RTK, Errors, record, rows, stand
from tests.autonomy.estimate.playback import error, localizer, play

FIELD_T = 3.8e-5
NOISE_T = 1.0e-6
SOFT = np.array([[1.12, 0.05], [0.05, 0.9]])
HARD_T = np.array([6e-6, -9e-6])


def fitted(
    angles: FloatArray, seed: int = 0, noise_t: float = NOISE_T, reference_rad: float = 0.0
) -> MagFitted | None:
    rng = np.random.default_rng(seed)
    fit = MagFit()
    for angle in angles:
        seen = SOFT @ (FIELD_T * np.array([math.cos(angle), math.sin(angle)])) + HARD_T
        seen = seen + noise_t * rng.standard_normal(2)
        fit.add((float(seen[0]), float(seen[1])), float(angle) + reference_rad)
    return fit.solve()


def heading_errors_rad(found: MagFitted) -> FloatArray:
    """Of true fields in all directions after the correction, without what is common to all."""
    errors = []
    for angle in np.linspace(0.0, math.tau, 72, endpoint=False):
        x, y = SOFT @ (FIELD_T * np.array([math.cos(angle), math.sin(angle)])) + HARD_T
        left, right = found.calibration.correct((float(x), float(y)))
        errors.append(math.remainder(math.atan2(right, left) - angle, math.tau))
    return np.asarray(np.array(errors) - np.mean(errors))


ROUND = np.linspace(0.0, 2.0 * math.tau, 300)


def test_an_ellipse_without_noise_is_found_exactly() -> None:
    found = fitted(ROUND, noise_t=0.0)
    assert found is not None and not found.complaints()
    np.testing.assert_allclose(found.calibration.offset_t, HARD_T, atol=1e-12)
    assert np.abs(heading_errors_rad(found)).max() < 1e-9
    assert found.field_t == pytest.approx(FIELD_T * math.sqrt(np.linalg.det(SOFT)))


def test_a_wrong_reference_turns_nothing() -> None:
    """All headings 20 degrees off: the same ellipse, so no heading is led astray."""
    found = fitted(ROUND, noise_t=0.0, reference_rad=math.radians(20.0))
    assert found is not None
    assert np.abs(heading_errors_rad(found)).max() < 1e-9
    assert found.turned_rad == pytest.approx(-math.radians(20.0), abs=0.02)


def test_over_seeds_the_headings_err_as_the_fit_says() -> None:
    worst, stated = [], []
    for seed in range(40):
        found = fitted(ROUND, seed)
        assert found is not None and not found.complaints()
        worst.append(np.sqrt(np.mean(heading_errors_rad(found) ** 2)))
        stated.append(found.std_rad)
    assert 0.4 < np.mean(worst) / np.mean(stated) < 1.2


def test_a_quarter_turn_is_not_enough_and_says_so() -> None:
    found = fitted(np.linspace(0.0, math.pi / 2.0, 300))
    assert found is None or found.complaints()
    assert fitted(np.zeros(100)) is None


def test_standing_in_one_direction_does_not_outweigh_the_turn() -> None:
    fit = MagFit()
    for _ in range(1000):
        fit.add((FIELD_T, 0.0), 0.1)
    assert fit.count == PER_SECTOR


def test_a_magnet_is_called_one() -> None:
    fit = MagFit()
    for angle in ROUND:
        fit.add((2.0 * FIELD_T * math.cos(angle), FIELD_T * math.sin(angle)), float(angle))
    found = fit.solve()
    assert found is not None
    assert "look for a magnet" in found.complaints()[0]


def late_headings(errors: Errors, seeds: Sequence[int], *, learns: bool) -> tuple[float, float]:
    """RMS of the heading's error in degrees after 40 s of rows, and its mean NEES."""
    deviations: list[float] = []
    nees = []
    for seed in seeds:
        recording = record(rows, 70.0, seed=seed, errors=errors)
        into = localizer(config=EstimateConfig(mag_learn=learns))
        for estimate in play(recording, into)[2000::50]:
            deviations.append(float(error(recording, estimate)[2]))
            nees.append((deviations[-1] / estimate.yaw_std_rad) ** 2)
    return math.degrees(float(np.sqrt(np.mean(np.square(deviations))))), float(np.mean(nees))


@nightly.all_or_first("seeds", range(5), in_suite=1)
@pytest.mark.parametrize("errors", [RTK, M8N], ids=["rtk", "m8n"])
def test_uncalibrated_iron_is_learnt_between_the_rows(errors: Errors, seeds: Sequence[int]) -> None:
    """Seventeen degrees of hard iron, where five are expected."""
    uncalibrated = msgspec.structs.replace(errors, hard_iron_rad=0.3)
    plain_deg, _ = late_headings(uncalibrated, seeds, learns=False)
    learnt_deg, nees = late_headings(uncalibrated, seeds, learns=True)
    assert learnt_deg < 0.8 * plain_deg
    assert 0.3 < nees < 1.48


def test_nothing_is_learnt_from_the_compass_itself() -> None:
    into = localizer()
    play(record(stand, 30.0, seed=1, errors=M8N), into)
    compass = into.ladders["mag"].correction
    assert isinstance(compass, Compass)
    assert compass._fit.count == 0


@nightly.all_or_first("seeds", range(4), in_suite=2)
def test_what_a_calibration_says_can_be_set(seeds: Sequence[int]) -> None:
    """The iron of this very robot, taken off from the first reading on."""
    deviations = []
    for seed in seeds:
        iron = msgspec.structs.replace(RTK, hard_iron_rad=0.3)
        recording = record(rows, 60.0, seed=seed, errors=iron)
        fit = MagFit()
        for sample in recording.mag:
            fit.add(sample.field_t[:2], math.pi / 2.0 - recording.pose(sample.t_s)[2])
        found = fit.solve()
        assert found is not None
        iron_free = EstimateConfig(
            mag_offset_t=found.calibration.offset_t, mag_shape=found.calibration.shape
        )
        early = msgspec.structs.replace(recording, truth=recording.truth[:300])
        deviations.append(
            [error(early, play(early, localizer(config=config))[-1])[2]
             for config in (EstimateConfig(), iron_free)]
        )  # fmt: skip
    plain, iron_free_rad = np.sqrt(np.mean(np.square(deviations), axis=0))
    assert iron_free_rad < 0.3 * plain
