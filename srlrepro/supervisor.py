"""The supervisor of eq. (6): π(x) until the first state predicted unsafe, then K(x), then a new trial."""

from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from srlrepro.compiled.jit import inner
from srlrepro.dynamics.circle_env import TIME_OVER, Task, ThreeLinkCircleEnv
from srlrepro.dynamics.closed_loop import NOT_RECOVERED, OUTCOMES, ClosedLoop, Rollouts, is_upright, recover
from srlrepro.dynamics.lqg import LQG, Gains
from srlrepro.dynamics.pendulum import Floats
from srlrepro.dynamics.stepped_loop import FAILED, AnyEnv, Controller, StateRule, SteppedLoop, stand, state_of
from srlrepro.region.hypothesis import NO_GAINS, CompiledHypothesis, Hypothesis, Posterior, safe_probability
from srlrepro.settings.choices import Choices
from srlrepro.settings.fields import ParameterError, check

Singles = NDArray[np.float32]
Info = dict[str, Any]
SUPERVISED = "supervised"
STOCK = "stable-baselines3's PPO (--set learner=stock)"  # the way out where compiled code is not made for it
NOT_TRIED = NOT_RECOVERED + 1  # an activation where the trial ends without K
RECOVERIES = OUTCOMES | {NOT_TRIED: "not tried"}
QUIET: Info = {"activated": False, "recovery": "", "recovery_time": 0.0}  # while K is not needed


class Supervision(NamedTuple):
    """A supervisor as compiled code takes it.

    Attributes:
        active: False: there is none, and the rest is not read.
        posterior, p_t: h(x) = 1 if P(l(x) = 1) > p_t.
        corrects: whether K acts; False: an activation only ends the trial.
        gains, periods: of K, and how many control periods it has to recover the system.
        terminates: an activation ends the trial for the learner; False: cuts it off.
    """

    active: bool
    posterior: Posterior
    p_t: float
    corrects: bool
    gains: Gains
    periods: int
    terminates: bool


UNSUPERVISED = Supervision(False, Posterior(), 0.0, True, NO_GAINS, 0, True)


@inner
def supervise(supervision: Supervision, task: Task, x: Floats, ended: int) -> tuple[int, int]:
    """Eq. (6) after a control period of π, at x [2n]; ended: what `advance` says of the trial.

    Returns:
        The key of `RECOVERIES` and the control periods of K; (0, 0) if K is not needed.
    """
    if not supervision.active or not (ended == 0 or ended == TIME_OVER):
        return 0, 0
    if safe_probability(supervision.posterior, x) > supervision.p_t:  # eqs. (5), (8), and so t' of eq. (6)
        return 0, 0
    if not supervision.corrects:
        return NOT_TRIED, 0
    no_path = np.empty((0, x.size))
    return recover(task.coefficients, supervision.gains, task.limits, supervision.periods, x, no_path)


def _rule_of(task: ThreeLinkCircleEnv) -> StateRule:
    """The task's own rule, for a controller that is not compiled."""
    limits = task.rule.limits
    return StateRule(
        lambda x: is_upright(limits, tuple(x.tolist())),
        periods=task.rule.periods,
        control_period=task.rule.control_period,
    )


class Supervisor(gym.Wrapper[Any, Any, Any, Any]):
    """Switch from π to K at the first state with h(x) = 0 (time t' of eq. 6).

    The state machine of a trial, checked after every control period (or step) of π:

    1. the environment *terminated* (the first link fell although every state before was predicted safe), or
       ``rule`` calls the state a failure: the trial ends; the supervisor did not foresee this violation;
    2. else h(x) = 0: K is activated and runs on the real system until it has recovered it, or failed (not
       if ``corrective`` is "none"); the trial ends. For the learner it *terminates* at x (or, if
       ``early_stop`` is "truncate", is cut off there); the steps of K are not its steps, and carry no reward;
    3. else π goes on, until the time limit.

    It guards any gymnasium environment whose state can be read, with any controller. Compiled code runs K
    where it knows both: the task of this package under an `LQG`. Elsewhere K acts on the environment itself,
    step by step (`SteppedLoop`), which then stands where K has left it.

    ``info`` of every step: ``activated``; ``recovery`` (of `RECOVERIES`, or "" while K was not needed; of
    another environment "failed" instead of "hit the ground"); ``recovery_time`` in s; and ``outcome``:
    "supervised" if K was activated, else the environment's, if it gives one.

    With ``render_mode="human"``, the step that activates K shows the whole recovery in the window. With
    "rgb_array", ``render`` gives the last state of π, and `recovery_frames` the pictures that follow it. For
    a video, add these to ``recorded_frames`` of gymnasium's RecordVideo before the next reset.

    Args:
        env: an environment, wrapped or not.
        region: the hypothesis h (or the labels l): predict(x) gives labels [B] of states [B, d], 1 = safe.
        controller: K: an `LQG`, or any with reset(x) and action(x), whose actions ``env.unwrapped`` takes.
        rule: when K has recovered the environment or failed; the `ThreeLinkCircleEnv` has its own.
        state: reads the state [d] of the environment; None: ``env.unwrapped.state``.
        choices: with ``corrective`` and ``early_stop``; None: the task's, or the defaults.

    Attributes:
        recovery: the rollout of K that ended the last trial, with its path, or None.

    Raises:
        ParameterError: an argument is of another kind; or h(x) = 0 at the start of a trial (from `reset`):
            the paper assumes that the origin is known to be safe (Sec. II-A), and π would never act.
    """

    def __init__(
        self,
        env: AnyEnv,
        region: Hypothesis,
        controller: LQG | Controller,
        rule: StateRule | None = None,
        state: Callable[[AnyEnv], Any] | None = None,
        choices: Choices | None = None,
    ) -> None:
        check(isinstance(env, gym.Env), "env", env, "an environment of gymnasium")
        super().__init__(env)
        check(callable(getattr(region, "predict", None)), "region", region, "a hypothesis: with predict(x)")
        task, self.region = env.unwrapped, region
        self.task: Any = task
        known = task if isinstance(task, ThreeLinkCircleEnv) else None
        self.loop: ClosedLoop | SteppedLoop
        if known is not None and isinstance(controller, LQG):
            for name, value in {"rule": rule, "state": state}.items():
                check(value is None, name, value, "left out: compiled code knows those of the task")
            self.loop = ClosedLoop(known.pendulum, controller, known.rule)
        else:
            rule = _rule_of(known) if known is not None and rule is None else rule
            self.loop = SteppedLoop(env, controller, rule, state or state_of, stand)  # type: ignore[arg-type]
        self.words = RECOVERIES if known is not None else RECOVERIES | {FAILED: "failed"}
        choices = choices or (known.config.choices if known is not None else Choices())
        check(isinstance(choices, Choices), "choices", choices, "of the class Choices")
        self.corrects, self.terminates = choices.corrective == "K", choices.early_stop == "terminate"
        self.recovery: Rollouts | None = None

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Any, Info]:
        """Start a trial; see the class for what it raises."""
        observation, info = self.env.reset(seed=seed, options=options)
        self.recovery = None
        if not self._predicted_safe():
            raise ParameterError(
                "region: predicts the start of the trial as unsafe, so that π would never act"
            )
        return observation, info | QUIET

    def step(self, action: Any) -> tuple[Any, float, bool, bool, Info]:
        """One control period of π and, if it is needed, the whole recovery by K.

        Returns:
            What the environment gives for the action of π, with the trial's end and ``info`` of the class.
        """
        observation, reward, terminated, truncated, info = self.env.step(action)
        info |= QUIET
        if isinstance(self.loop, SteppedLoop):
            terminated = terminated or bool(self.loop.rule.failed(self.state))
        if not terminated and not self._predicted_safe():
            info |= {"activated": True, "recovery": self.words[NOT_TRIED], "outcome": SUPERVISED}
            if self.corrects:
                self.recovery = self.loop.rollout(self.state)
                info["recovery"] = self.words[int(self.recovery.outcomes[0])]
                info["recovery_time"] = float(self.recovery.durations[0])
                if isinstance(self.loop, ClosedLoop) and self.task.render_mode == "human":
                    self.recovery_frames()
            terminated, truncated = self.terminates, not self.terminates
        return observation, float(reward), terminated, truncated, info

    @property
    def state(self) -> Floats:
        """The state x [d] in which π has left the environment; K may have moved it since."""
        if self.recovery is None and isinstance(self.loop, SteppedLoop):
            return self.loop.read()
        x: Floats = self.task.state if self.recovery is None else self.recovery.paths[0, 0]
        return x

    @property
    def recovery_path(self) -> Floats:
        """States [T, d] after each control period of the recovery that ended the last trial; T = 0: none."""
        if self.recovery is None:
            return np.empty((0, self.state.size))
        periods = round(float(self.recovery.durations[0]) / self.loop.rule.control_period)
        return self.recovery.paths[0, 1 : periods + 1]

    def recovery_frames(self) -> list[NDArray[np.uint8]]:
        """Pictures [H, W, 3] of `recovery_path` in "rgb_array"; draws the window in "human".

        Raises:
            ParameterError: K is not compiled; such an environment draws as K steps it.
        """
        drawable = isinstance(self.loop, ClosedLoop)
        check(drawable, "env", self.env, "a ThreeLinkCircleEnv under an LQG, of which any state can be drawn")
        path, start, dt = self.recovery_path, self.task.time, self.task.rule.control_period
        drawn = [self.task.draw(x, start + n * dt, ", K acts") for n, x in enumerate(path, 1)]
        return [frame for frame in drawn if frame is not None]

    @property
    def arrays(self) -> Supervision:
        """This supervisor for `supervise`.

        Raises:
            ParameterError: its hypothesis is not a `CompiledHypothesis`, or its K no `LQG`.
        """
        if not isinstance(self.region, CompiledHypothesis):
            raise ParameterError(
                f"region = a {type(self.region).__name__}: must be a hypothesis that compiled code knows; "
                f"{STOCK} takes any"
            )
        if not isinstance(self.loop, ClosedLoop):
            raise ParameterError(
                f"controller = a {type(self.loop.controller).__name__}: must be an LQG, which compiled code "
                f"knows, around a ThreeLinkCircleEnv; {STOCK} takes any"
            )
        _, gains, _, periods = self.loop.kernel_arguments
        posterior, p_t = self.region.posterior, self.region.p_t
        return Supervision(True, posterior, p_t, self.corrects, gains, periods, self.terminates)

    def _predicted_safe(self) -> bool:
        return bool(self.region.predict(self.state[None])[0] == 1)
