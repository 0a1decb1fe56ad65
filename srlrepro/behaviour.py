"""Trials to look at: what π does, where the supervisor steps in, and how K fares."""

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from stable_baselines3.common.base_class import BaseAlgorithm

from srlrepro.drawing import LINK, TARGET, draw_pendulum
from srlrepro.env import ThreeLinkCircleEnv, target
from srlrepro.files import ResultError, beside, bounded_archive, check_unpacked
from srlrepro.pendulum import Floats
from srlrepro.supervisor import Supervisor

CORRECTIVE = "#0072B2"  # the pendulum while K acts
COLOURS = 64  # of a picture
REST = 0.5  # s that the last picture of a trial stays


@dataclass(frozen=True)
class Trial:
    """One trial, with the recovery by K if there was one.

    Attributes:
        joints: [T + 1, 4, 2] m, at the control instants.
        targets: [T + 1, 2] m, p_d at the same instants.
        supervised: [T + 1] whether K acts from the instant on.
        total: return of π; steps: its control periods.
        outcome: of the trial, and of K if it was activated.
    """

    joints: Floats
    targets: Floats
    supervised: NDArray[np.bool_]
    total: float
    steps: int
    outcome: str


def load_policy(path: Path, learner: BaseAlgorithm) -> BaseAlgorithm:
    """The learner, with the parameters of the policy that the archive of a run holds.

    stable-baselines3's own ``load`` unpickles, and a pickle can run any code. Only the tensors are read
    here, by torch's reader of plain weights.

    Raises:
        ResultError: the archive is missing, too large, damaged, or of another kind of policy.
    """
    bounded_archive(path)
    try:
        with zipfile.ZipFile(path) as archive:
            for part in (name for name in archive.namelist() if name.endswith(".pth")):
                with zipfile.ZipFile(io.BytesIO(archive.read(part))) as tensors:
                    check_unpacked(tensors, path)
        learner.set_parameters(str(path), device="cpu")
    except ResultError:
        raise
    except Exception as error:  # torch raises a dozen kinds
        raise ResultError(f"{path} is truncated or holds no such policy") from error
    return learner


def run_trial(model: BaseAlgorithm, env: gym.Env[Any, Any], deterministic: bool) -> Trial:
    """One trial of a policy from the origin; with its mean actions if ``deterministic``."""
    task = env.unwrapped
    assert isinstance(task, ThreeLinkCircleEnv)
    observation, info = env.reset()
    states, total, ended = [task.state.copy()], 0.0, False
    while not ended:
        action, _ = model.predict(observation, deterministic=deterministic)
        observation, reward, terminated, truncated, info = env.step(action)
        states.append(task.state.copy())
        total, ended = total + float(reward), terminated or truncated
    steps, outcome = len(states) - 1, info["outcome"]
    recovery = env.recovery if isinstance(env, Supervisor) else None
    if recovery is not None:
        periods = round(float(recovery.durations[0]) / task.rule.control_period)
        states += list(recovery.paths[0, 1 : periods + 1])
        outcome = f"K: {info['recovery']}"
    times = task.rule.control_period * np.arange(len(states))
    circle = np.array([target(task.arrays.circle, float(t)) for t in times])
    supervised = np.arange(len(states)) >= (steps if recovery is not None else len(states))
    return Trial(task.pendulum.joints(np.array(states)), circle, supervised, total, steps, outcome)


def animate_trials(
    path: Path, trials: Sequence[tuple[str, Trial]], task: ThreeLinkCircleEnv, fps: int = 20
) -> None:
    """Write a GIF in real time with one panel per titled trial, side by side; short trials hold their end."""
    period, paper = task.rule.control_period, task.config.paper
    stride = max(1, round(1.0 / (fps * period)))
    longest = max(len(trial.joints) for _, trial in trials) + round(REST / period)
    figure = Figure(figsize=(3.2 * len(trials), 2.9), dpi=64, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    parts = []
    for ax, (title, trial) in zip(figure.subplots(1, len(trials), squeeze=False)[0], trials, strict=True):
        line = draw_pendulum(ax, trial.joints[0], paper)
        (goal,) = ax.plot([], [], "o", color=TARGET, markersize=5)
        (trace,) = ax.plot([], [], "-", color="#56B4E9", linewidth=1)
        ax.set(xlim=(-2.2, 2.2), ylim=(-0.3, 3.4))
        ax.set_title(title, fontsize=9)
        parts.append((trial, trace, line, goal, ax.text(-2.1, 3.1, "", fontsize=8)))
    clock = figure.suptitle("t = 0.00 s", fontsize=9)
    moving: list[Artist] = [clock, *(artist for _, *artists in parts for artist in artists)]
    for artist in moving:
        artist.set_animated(True)  # left out of the background, which is drawn only once
    canvas.draw()
    background, pictures = canvas.copy_from_bbox(figure.bbox), []
    for t in range(0, longest, stride):
        for trial, trace, line, goal, words in parts:
            now = min(t, len(trial.joints) - 1)
            line.set_data(*trial.joints[now].T)
            line.set_color(CORRECTIVE if trial.supervised[now] else LINK)
            goal.set_data(trial.targets[now, :1], trial.targets[now, 1:])
            goal.set_visible(not trial.supervised[now])
            trace.set_data(*trial.joints[: min(now, trial.steps) + 1, -1].T)
            acting = "K(x) acts" if trial.supervised[now] else "π(x) acts"
            words.set_text(trial.outcome if now == len(trial.joints) - 1 else acting)
        clock.set_text(f"t = {t * period:.2f} s")
        canvas.restore_region(background)
        for artist in moving:
            figure.draw_artist(artist)
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]).quantize(COLOURS))
    with beside(path) as temporary:
        milliseconds = round(1000 * stride * period)
        pictures[0].save(temporary, save_all=True, append_images=pictures[1:], duration=milliseconds, loop=0)
