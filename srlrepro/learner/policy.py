"""Final policies to take home: the actor of a trained learner as plain arrays, for numpy alone.

    μ(o) = W_n tanh(… tanh(W_1 o + b_1) …) + b_n,   a = clip(μ(o) + σ ε, −a_max, a_max)

The critic stays behind: to act needs π alone, and to go on with a training needs Adam's moments as well,
which only a checkpoint has. Sums are formed in double precision, so that no finite weight or observation
overflows; actions agree with those of stable-baselines3 to the rounding of its single precision.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from srlrepro.settings.condition import Condition
from srlrepro.settings.config import Config
from srlrepro.settings.fields import check, one_line
from srlrepro.storage.files import ResultError, parse_json, read_arrays, write_arrays

if TYPE_CHECKING:
    from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

FORMAT = "srlrepro-policy-1"
MOST_LAYERS = 64  # that a file may name; the paper has three

Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class TrainedPolicy:
    """π as arrays, with stable-baselines3's ``predict``.

    Attributes:
        weights: of each layer, first to last, [outputs, inputs]; biases: [outputs]. tanh lies between layers.
        log_std: [m] log σ of the actions.
        largest: [m] a_max, bound of the actions in units of ``action_unit``.
        record: what run.json says of the training, but not on which machine; {} of a policy made by hand.

    Raises:
        ParameterError: arrays of another type than float32, that do not fit together, or not finite.
    """

    weights: tuple[Single, ...]
    biases: tuple[Single, ...]
    log_std: Single
    largest: Single
    record: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        parts = (*self.weights, *self.biases, self.log_std, self.largest)
        plain = all(isinstance(p, np.ndarray) and p.dtype == np.float32 for p in parts)
        check(plain, "policy", "parts of another type", "arrays of float32")
        outputs = [w.shape[0] if w.ndim == 2 else 0 for w in self.weights]
        inputs = [w.shape[1] if w.ndim == 2 else 0 for w in self.weights]
        fits = len(outputs) > 0 and min(outputs + inputs) > 0 and inputs[1:] == outputs[:-1]
        fits = fits and [b.shape for b in self.biases] == [(n,) for n in outputs]
        fits = fits and self.log_std.shape == self.largest.shape == (outputs[-1],)
        check(fits, "policy", [p.shape for p in parts], "layers that fit together")
        with np.errstate(over="ignore"):
            std = np.exp(self.log_std.astype(np.float64))
        finite = all(np.isfinite(p).all() for p in (*parts, std)) and bool((self.largest > 0).all())
        check(finite, "policy", "other values", "finite numbers, with a bound of the actions above 0")

    @property
    def condition(self) -> Condition | None:
        """The condition it was trained in; None of a policy made by hand."""
        run = self.record.get("run")
        return None if run is None else Condition(run["alpha"], run["delta"], run["seed"])

    @property
    def config(self) -> Config:
        """The values it was trained with; of a policy made by hand, the defaults."""
        return Config().with_values(**self.record.get("config", {}))

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
        rng: Generator | None = None,
    ) -> tuple[Single, Any]:
        """Actions as those of stable-baselines3's ``predict``, but that chance is passed.

        Args:
            observation: [n] or [B, n].
            state, episode_start: of recurrent policies; this one is none.
            deterministic: the mean actions, else drawn with ``rng``.

        Returns:
            Actions [m] or [B, m] in units of ``action_unit``, within ±``largest``, and ``state`` as it was.

        Raises:
            ParameterError: an observation of another shape or not finite, or no ``rng`` to draw with.
        """
        given, size = np.asarray(observation), self.weights[0].shape[1]
        fits = given.dtype.kind in "fiu" and given.ndim in (1, 2) and given.shape[-1] == size
        found = f"{given.dtype} of shape {list(given.shape)}"
        check(fits, "observation", found, f"numbers of shape [{size}] or [B, {size}]")
        with np.errstate(over="ignore"):
            values = given.astype(np.float32).astype(np.float64)  # what the learner saw were float32
        check(bool(np.isfinite(values).all()), "observation", "other values", "finite numbers")
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            values = np.tanh(values @ weight.T + bias)
        actions = values @ self.weights[-1].T + self.biases[-1]
        if not deterministic:
            drawn = isinstance(rng, Generator)
            check(drawn, "rng", rng, "numpy's Generator, to draw actions with (deterministic=False)")
            assert rng is not None
            actions += np.exp(self.log_std.astype(np.float64)) * rng.standard_normal(actions.shape)
        return np.clip(actions, -self.largest, self.largest).astype(np.float32), state

    @classmethod
    def of(cls, model: "OnPolicyAlgorithm", record: Mapping[str, Any] | None = None) -> "TrainedPolicy":
        """A copy of the actor of a learner with the ``MlpPolicy`` and tanh, such as `CompiledPPO`."""
        actor = model.policy.mlp_extractor.policy_net, model.policy.action_net
        values = [p.detach().numpy().copy() for part in actor for p in part.parameters()]
        log_std, largest = model.policy.log_std.detach().numpy().copy(), model.action_space.high.copy()  # type: ignore[attr-defined]
        return cls(tuple(values[::2]), tuple(values[1::2]), log_std, largest, dict(record or {}))

    def save(self, path: Path) -> None:
        """Write it as npz: arrays and text, no pickle, the same bytes each time."""
        layers = {f"weight_{n}": w for n, w in enumerate(self.weights)}
        layers |= {f"bias_{n}": b for n, b in enumerate(self.biases)}
        record = json.dumps(dict(self.record), ensure_ascii=False, sort_keys=True, allow_nan=False)
        rest = {"log_std": self.log_std, "largest": self.largest, "record": np.array(record)}
        write_arrays(path, FORMAT, layers=np.array(len(self.weights)), **layers, **rest)


def record_of(result: Mapping[str, Any]) -> dict[str, Any]:
    """What a policy tells of its training: all that run.json says, but its provenance."""
    return {name: value for name, value in result.items() if name != "provenance"}


def load_policy(path: Path) -> TrainedPolicy:
    """Read what `TrainedPolicy.save` wrote, without torch or stable-baselines3; nothing in it is run.

    Raises:
        ResultError: the file is missing, damaged, of another kind, or holds values that are not allowed.
    """
    layers = read_arrays(path, FORMAT, ("layers",))["layers"]
    if layers.shape != () or layers.dtype.kind not in "iu" or not 1 <= layers <= MOST_LAYERS:
        raise ResultError(f"{path} holds a policy whose parts do not fit together: its number of layers")
    weights, biases = ([f"{part}_{n}" for n in range(int(layers))] for part in ("weight", "bias"))
    a = read_arrays(path, FORMAT, (*weights, *biases, "log_std", "largest", "record"))
    try:
        record = parse_json(str(a["record"]))
        if not isinstance(record, dict):
            raise ValueError("its record is no table")
        parts = tuple(a[name] for name in weights), tuple(a[name] for name in biases)
        policy = TrainedPolicy(*parts, a["log_std"], a["largest"], record)
        if record:
            Condition(record["run"]["alpha"], record["run"]["delta"], record["run"]["seed"])
            if Config().with_values(**record["config"]).as_dict().keys() != record["config"].keys():
                raise ValueError("its record lacks the value of a parameter")
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ResultError(f"{path} holds no such policy: {one_line(error)}") from error
    return policy
