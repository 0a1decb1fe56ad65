r"""The distribution term of Theorem 1: half an HΔH-divergence, estimated from samples of D and D_n.

For a class H of labelling functions (Ben-David et al., A theory of learning from different domains, 2010),

    ½ d_HΔH(D, D_n) = sup_{h, h' ∈ H} |P_D(h ≠ h') − P_Dn(h ≠ h')|  ∈ [0, 1].

It grows with H, up to the total variation distance when H holds every measurable function. Two estimates:

* a finite H, from the labels that each of its members gives the states: exact for the two samples, so that
  what holds for every pair of distributions holds for the estimate as well;
* a classifier that tells states of D from states of D_n: a set G of states with P_D(G) − P_Dn(G) large, found
  on one part of the states and measured on the other. It is a lower bound of the divergence of every class
  with G among its symmetric differences, and of the total variation.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.distance import pdist
from sklearn.base import ClassifierMixin
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import PredefinedSplit, cross_val_predict
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from sklearn.svm import SVC

from srlrepro.settings.fields import check

# scikit-learn's defaults; "quadratic" contains the symmetric differences of two half-spaces
DOMAIN_CLASSIFIERS: dict[str, ClassifierMixin] = {
    "half-spaces": make_pipeline(StandardScaler(), LogisticRegression()),
    "quadratic": make_pipeline(
        StandardScaler(), PolynomialFeatures(2), StandardScaler(), LogisticRegression()
    ),
    "RBF-SVM": make_pipeline(StandardScaler(), SVC()),
    "k-NN": make_pipeline(StandardScaler(), KNeighborsClassifier()),
    "boosted trees": HistGradientBoostingClassifier(random_state=0),
}


class HalfDivergence(NamedTuple):
    """½ d_HΔH(D, D_n), and the standard error that the finite numbers of states leave."""

    value: float
    standard_error: float


def finite_class(target: ArrayLike, source: ArrayLike) -> HalfDivergence:
    """½ d_HΔH of a finite H between two samples, a maximum over all pairs of its members.

    target: [N, M] labels of N states of D by the M members of H; source: [N', M] of N' states of D_n.
    `ParameterError`: other shapes.
    """
    d, d_n = np.asarray(target), np.asarray(source)
    fits = d.ndim == d_n.ndim == 2 and d.shape[1] == d_n.shape[1] and len(d) > 0 and len(d_n) > 0
    check(fits, "labels", f"shapes {d.shape} and {d_n.shape}", "of shapes [N, M] and [N', M]")
    check(d.shape[1] >= 2, "labels", f"{d.shape[1]} members of H", "at least two")
    p, p_n = pdist(d.T, "hamming"), pdist(d_n.T, "hamming")  # P(h ≠ h') of every pair
    widest = np.abs(p - p_n).argmax()
    value, error = _difference(p[widest], len(d), p_n[widest], len(d_n))
    return HalfDivergence(abs(value), error)


def domain_classifier(
    classifier: ClassifierMixin, target: ArrayLike, source: ArrayLike, folds: ArrayLike
) -> HalfDivergence:
    """P_D(G) − P_Dn(G) of the sets G that a classifier learns to be D's: a held-out lower bound.

    Each fold is predicted by the classifier of the others. The value of a class that sees no difference
    scatters about 0.

    Args:
        target: [N, 2n] states of D; source: [N', 2n] states of D_n, of about as many.
        folds: [N] fold of each state of D, 0 to F − 1, of two at least; the states of D_n take turns.
    """
    d, d_n, fold = np.asarray(target), np.asarray(source), np.asarray(folds)
    count = len(np.unique(fold))
    check(count >= 2, "folds", count, "at least two")
    domain = np.repeat([1, 0], [len(d), len(d_n)])
    split = PredefinedSplit(np.concatenate([fold, np.arange(len(d_n)) % count]))
    found: NDArray[np.int64] = cross_val_predict(classifier, np.concatenate([d, d_n]), domain, cv=split)
    p, p_n = found[domain == 1].mean(), found[domain == 0].mean()
    return _difference(p, len(d), p_n, len(d_n))


def _difference(p: float, n: int, p_n: float, n_n: int) -> HalfDivergence:
    """p − p_n of two shares, of n and of n_n states."""
    error = np.sqrt(p * (1 - p) / n + p_n * (1 - p_n) / n_n)
    return HalfDivergence(float(p - p_n), float(error))
