"""½ d_HΔH: finite classes against enumeration, domain classifiers against closed forms."""

import itertools

import numpy as np
import pytest
from numpy.random import Generator
from scipy.stats import norm

from replication.studies.divergence import DOMAIN_CLASSIFIERS, domain_classifier, finite_class

FOLDS = np.arange(2000) % 2


def space(counts: np.ndarray) -> np.ndarray:
    """A distribution on a finite space as the list of its points, repeated."""
    return np.repeat(np.arange(len(counts)), counts)


def test_a_finite_class_is_the_maximum_over_its_pairs(rng: Generator) -> None:
    a, b = rng.integers(0, 2, (30, 5)), rng.integers(0, 2, (50, 5))
    pairs = itertools.combinations(range(5), 2)
    expected = max(abs((a[:, i] != a[:, j]).mean() - (b[:, i] != b[:, j]).mean()) for i, j in pairs)
    assert finite_class(a, b).value == pytest.approx(expected)


def test_every_labelling_of_a_space_gives_the_total_variation(rng: Generator) -> None:
    every = np.array(list(itertools.product((0, 1), repeat=6))).T  # [6, 64]
    p, q = rng.integers(1, 9, 6), rng.integers(1, 9, 6)
    variation = 0.5 * np.abs(p / p.sum() - q / q.sum()).sum()
    assert finite_class(every[space(p)], every[space(q)]).value == pytest.approx(variation)


def test_a_class_grows_its_divergence(rng: Generator) -> None:
    a, b = rng.integers(0, 2, (40, 8)), rng.integers(0, 2, (40, 8))
    values = [finite_class(a[:, :m], b[:, :m]).value for m in range(2, 9)]
    assert values == sorted(values)


def test_the_standard_error_is_that_of_repeated_samples(rng: Generator) -> None:
    """Of h = 0 and h' with P_D(h') = 0.7, P_Dn(h') = 0.2."""

    def sample(p: float, n: int) -> np.ndarray:
        return np.stack([np.zeros(n), rng.uniform(size=n) < p], axis=1)

    draws = [finite_class(sample(0.7, 200), sample(0.2, 100)) for _ in range(500)]
    values, errors = np.array(draws).T
    assert values.mean() == pytest.approx(0.5, abs=0.01)
    assert values.std() == pytest.approx(errors.mean(), rel=0.1)


@pytest.mark.parametrize("name", DOMAIN_CLASSIFIERS)
def test_domains_that_are_equal_or_disjoint(name: str, rng: Generator) -> None:
    """0 for one and the same law, the maximum of 1 for two that share no state."""
    x, y = rng.uniform(-1, 1, (2, 2000, 3))
    same = domain_classifier(DOMAIN_CLASSIFIERS[name], x, y, FOLDS)
    assert abs(same.value) < 4 * same.standard_error
    assert domain_classifier(DOMAIN_CLASSIFIERS[name], x + 2.5, y, FOLDS).value > 0.99


def test_two_centred_normal_laws_differ_for_all_but_half_spaces(rng: Generator) -> None:
    """N(0, 1) and N(0, 3²): half-spaces see nothing; the best set is |x| < c, its value the variation."""
    x, y = rng.normal(0, 1, (2000, 1)), rng.normal(0, 3, (2000, 1))
    c = np.sqrt(2 * np.log(3) / (1 - 1 / 9))  # where the densities are equal
    variation = 2 * (norm.cdf(c) - norm.cdf(c / 3))
    found = {name: domain_classifier(d, x, y, FOLDS) for name, d in DOMAIN_CLASSIFIERS.items()}
    assert abs(found["half-spaces"].value) < 0.1
    assert found["quadratic"].value == pytest.approx(variation, abs=0.04)
    assert all(d.value < variation + 0.04 for d in found.values())
    assert all(d.value > 0.7 * variation for name, d in found.items() if name != "half-spaces")


def test_a_set_learned_from_one_training_is_measured_on_the_other(rng: Generator) -> None:
    """Two trainings at opposite places: what tells one from D_n does not tell the other."""
    x = np.concatenate([rng.normal(-5, 0.1, (1000, 1)), rng.normal(5, 0.1, (1000, 1))])
    y = rng.uniform(-8, 8, (2000, 1))
    unseen = domain_classifier(DOMAIN_CLASSIFIERS["k-NN"], x, y, np.repeat([0, 1], 1000))
    assert domain_classifier(DOMAIN_CLASSIFIERS["k-NN"], x, y, FOLDS).value > 0.9
    assert unseen.value < 0.05


def test_what_is_not_allowed_is_named() -> None:
    with pytest.raises(ValueError, match=r"shapes \(3, 2\) and \(3, 4\)"):
        finite_class(np.zeros((3, 2)), np.zeros((3, 4)))
    with pytest.raises(ValueError, match="1 members of H: must be at least two"):
        finite_class(np.zeros((3, 1)), np.zeros((3, 1)))
    with pytest.raises(ValueError, match="folds = 1: must be at least two"):
        domain_classifier(DOMAIN_CLASSIFIERS["k-NN"], np.zeros((3, 6)), np.zeros((3, 6)), np.zeros(3))
