"""Trained policy read from its file, and its evaluation in numpy.

Each channel that was normalised in training is normalised here, as by ``VecNormalize``:
x' = clip((x − mean) / √(variance + ε)). A field of touch passes, pad by pad, through the network of
`ruffini.sb3.TouchExtractor`. All features together are the input of a perceptron, whose last layer
outputs the mean of the action. The file is safetensors, with a `Card` as JSON in the metadata.

Shapes: N environments, C numbers of a channel, H width of a layer, F features, A = 5 numbers of an
action.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, TypedDict

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ruffini._core import read_tensors, write_tensors
from ruffini._spaces import ACTION_SIZE, replace_file
from ruffini.evaluation import ProgressCallback, evaluate

FORMAT = 1
"""Version of the file's layout."""

MOST_BYTES = 300_000
"""Largest file of an agent that comes with the package."""

SUFFIX = ".safetensors"
"""Suffix of an agent's file."""

Floats = NDArray[np.float32]


class Network(TypedDict):
    """Sizes of an agent's network."""

    order: list[str]
    """Channels in the order in which the policy reads them."""
    touch: dict[str, list[int]]
    """Channels that are fields of touch, with the layer widths of their networks."""
    policy: list[int]
    """Widths of the policy's hidden layers."""
    value: list[int] | None
    """Widths of the value function's hidden layers; none if it saw more than the agent sees."""
    activation: str
    """Activation between those layers: a key of `ACTIVATIONS`."""


class Normaliser(TypedDict):
    """Normalisation of the observations."""

    channels: list[str]
    """Channels that are normalised."""
    count: float
    """Number of observations in the statistics."""
    clip: float
    """Bound of the normalised values."""
    epsilon: float
    """Constant added to the variance."""


class Card(TypedDict):
    """Description of an agent and its success."""

    format: int
    """`FORMAT` of the file."""
    ruffini: str
    """Version of ruffini that wrote it."""
    commit: str
    """Commit with which it was trained."""
    env: str
    """Id of its environment."""
    settings: dict[str, Any]
    """Keyword arguments of the environment that it was trained in."""
    channels: dict[str, int]
    """Channels of the observation in the environment's order, with their sizes."""
    algorithm: str
    policy: str
    """Stable-Baselines3's policy: ``MultiInputPolicy``, or ``MlpPolicy`` of flat observations."""
    hyperparameters: dict[str, Any]
    """Keyword arguments of the algorithm, and ``n_envs``."""
    seed: int
    """Seed of the training run."""
    steps: int
    """Environment steps of the training run."""
    threads: int
    """Threads of the training run."""
    evaluation: dict[str, Any]
    """``success``, its 95 % ``interval``, ``return``, over ``episodes`` seeds from ``first_seed``.

    Result of :func:`ruffini.evaluation.evaluate` for the agent, without its single episodes; empty
    if it was not evaluated.
    """
    network: Network
    normaliser: Normaliser


ACTIVATIONS: dict[str, Callable[[Floats], Floats]] = {
    "Tanh": np.tanh,
    "ReLU": lambda x: np.maximum(x, np.float32(0)),
    "ELU": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, np.float32(0)))),
}
"""Activations by their names in torch."""


class Agent:
    """A trained policy with its card; `ruffini.agents.load` makes one.

    Args:
        card: Description of the agent.
        tensors: Arrays by name, with the shapes that `shapes` returns.
        name: Name of the agent in error messages.

    Raises:
        ValueError: If the card has another format or is incomplete, or the tensors do not fit it.
    """

    def __init__(
        self, card: Card, tensors: Mapping[str, NDArray[Any]], name: str = "agent"
    ) -> None:
        self.card, self.tensors, self.name = card, dict(tensors), name
        _check_card(card, name)
        _check_tensors(card, self.tensors, name)
        self.seed(0)

    @classmethod
    def read(cls, path: str | PathLike[str]) -> Agent:
        """Read the agent in a file.

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If it is no readable file of an agent.
        """
        try:
            data = Path(path).read_bytes()
        except FileNotFoundError:
            raise
        except OSError as error:
            raise ValueError(f"agent {path}: {error.strerror}") from None
        try:
            tensors, text = read_tensors(data)
            card = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ValueError(f"agent {path}: {error}") from None
        return cls(card, tensors, f"agent {path}")

    def to_bytes(self) -> bytes:
        """Bytes of the agent's file."""
        return write_tensors(self.tensors, json.dumps(self.card))

    def write(self, path: str | PathLike[str]) -> None:
        """Write the agent's file.

        Raises:
            ValueError: If it cannot be written.
        """
        replace_file(Path(path), self.to_bytes())

    def evaluate(self, episodes: int = 200, progress: ProgressCallback | None = None) -> None:
        """Evaluate the agent in its environment, and put the result on its card.

        Args:
            episodes: Number of episodes, one per seed.
            progress: Callback after every step; see `ProgressCallback`.
        """
        result = evaluate(self, self.env_id, episodes, progress=progress, **self.settings)
        left = ("env", "outcomes")
        self.card["evaluation"] = {k: value for k, value in result.items() if k not in left}

    @property
    def env_id(self) -> str:
        """Id of its environment."""
        return self.card["env"]

    @property
    def settings(self) -> dict[str, Any]:
        """Keyword arguments of the environment that it was trained in."""
        return dict(self.card["settings"])

    @property
    def channels(self) -> dict[str, int]:
        """Channels of its observations in the environment's order, with their sizes."""
        return dict(self.card["channels"])

    def check(self, space: gym.Space[Any]) -> None:
        """Check that observations of `space` are those on which the agent was trained.

        Raises:
            ValueError: If their channels or sizes differ.
        """
        if isinstance(space, gym.spaces.Dict):
            expected = {name: int(np.prod(box.shape or ())) for name, box in space.items()}
            if expected != self.card["channels"]:
                raise ValueError(
                    f"{self.name}: found channels {_listed(self.channels)}, "
                    f"expected the environment's: {_listed(expected)}"
                )
        elif space.shape != (self._size(),):
            raise ValueError(
                f"{self.name}: found observations of {self._size()} numbers, "
                f"expected the environment's shape {space.shape}"
            )

    def seed(self, seed: int | None) -> None:
        """Restart the random stream of predictions that are not deterministic."""
        self._random = np.random.default_rng(seed)

    def predict(
        self,
        observation: Floats | Mapping[str, Floats],
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Floats, Any]:
        """Actions (N, 5) for observations of N environments, or (5,) for those of one.

        Args:
            observation: A mapping of channels (N, C) or (C,), or all channels in a row in the
                environment's order, as with ``obs="flat"``.
            state: Returned unchanged.
            episode_start: Not used.
            deterministic: If false, actions are drawn from the policy's distribution, as in
                training.

        Raises:
            ValueError: If a channel is missing, of another size, or not finite.
        """
        channels = self._cut(observation)
        single = next(iter(channels.values())).ndim == 1
        rows = {name: np.atleast_2d(values) for name, values in channels.items()}
        mean = self._layers("policy", self._features(rows), self.card["network"]["activation"])
        if not deterministic:
            noise = self._random.standard_normal(mean.shape, np.float32)
            mean = mean + np.exp(self.tensors["log_std"]) * noise
        action = np.clip(mean, np.float32(-1), np.float32(1))
        return (action[0] if single else action), state

    def _size(self) -> int:
        return sum(self.card["channels"].values())

    def _cut(self, observation: Any) -> dict[str, Floats]:
        """Split an observation into its channels, and check them."""
        sizes = self.card["channels"]
        if isinstance(observation, Mapping):
            missing = [name for name in sizes if name not in observation]
            if missing:
                found = ", ".join(observation)
                raise ValueError(f"observation: found {found}, expected also {', '.join(missing)}")
            given = {name: np.asarray(observation[name], np.float32) for name in sizes}
        else:
            values = np.asarray(observation, np.float32)
            _check_shape("observation", values, self._size())
            parts = np.split(values, np.cumsum(list(sizes.values()))[:-1], axis=-1)
            given = dict(zip(sizes, parts, strict=True))
        for name, values in given.items():
            _check_shape(f"observation[{name!r}]", values, sizes[name])
            wrong = values[~np.isfinite(values)]
            if wrong.size:
                found = f"{wrong[0]} in {wrong.size} of {values.size} numbers"
                raise ValueError(f"observation[{name!r}]: found {found}, expected finite numbers")
        if len({values.shape[:-1] for values in given.values()}) > 1:
            found = ", ".join(f"{name} {values.shape}" for name, values in given.items())
            raise ValueError(f"observation: found {found}, expected as many rows of each")
        return given

    def _features(self, channels: dict[str, Floats]) -> Floats:
        """Features (N, F) of channels (N, C)."""
        network, normalised = self.card["network"], self.card["normaliser"]["channels"]
        parts = []
        for name in network["order"]:
            values = channels[name]
            if name in normalised:
                values = self._normal(name, values)
            if name in network["touch"]:
                values = self._touch(name, values)
            parts.append(values)
        return np.concatenate(parts, axis=1)

    def _normal(self, name: str, values: Floats) -> Floats:
        """Normalise a channel (N, C) as ``VecNormalize`` does."""
        normaliser = self.card["normaliser"]
        mean = self.tensors[f"normaliser.{name}.mean"]
        variance = self.tensors[f"normaliser.{name}.variance"]
        normal = (values - mean) / np.sqrt(variance + normaliser["epsilon"])
        clipped: Floats = np.clip(normal, -normaliser["clip"], normaliser["clip"])
        return clipped.astype(np.float32)

    def _touch(self, name: str, values: Floats) -> Floats:
        """Features of both pads (N, 2 H) of a field of touch (N, C)."""
        pads = values.reshape(len(values), 2, -1) * self.tensors[f"touch.{name}.scale"]
        features = np.tanh(self._layers(f"touch.{name}", pads, "Tanh"))
        strong: Floats = self.tensors[f"touch.{name}.strength"] * features
        return strong.reshape(len(values), -1)

    def _layers(self, name: str, values: Floats, activation: str) -> Floats:
        """Output of a perceptron, without an activation after its last layer.

        Sums are taken in float64 and rounded, so that a row's action does not depend on how many
        rows there are: an episode that is filmed alone is the one that was counted in a batch.
        """
        layer = 0
        while f"{name}.{layer}.weight" in self.tensors:
            if layer > 0:
                values = ACTIVATIONS[activation](values)
            weight, bias = (self.tensors[f"{name}.{layer}.{part}"] for part in ("weight", "bias"))
            values = (values.astype(np.float64) @ weight.T + bias).astype(np.float32)
            layer += 1
        return values


def shapes(card: Card) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the tensors of an agent's file.

    ``normaliser.*`` are float64, as in ``VecNormalize``; the others are float32.
    """
    network, found = card["network"], dict[str, tuple[int, ...]]()
    for name in card["normaliser"]["channels"]:
        for part in ("mean", "variance"):
            found[f"normaliser.{name}.{part}"] = (card["channels"][name],)
    features = 0
    for name in network["order"]:
        size = card["channels"][name]
        if name in network["touch"]:
            widths = network["touch"][name]
            found[f"touch.{name}.scale"], found[f"touch.{name}.strength"] = (2, size // 2), ()
            found |= _perceptron(f"touch.{name}", [size // 2, *widths])
            size = 2 * widths[-1]
        features += size
    found |= _perceptron("policy", [features, *network["policy"], ACTION_SIZE])
    if network["value"] is not None:
        found |= _perceptron("value", [features, *network["value"], 1])
    return found | {"log_std": (ACTION_SIZE,)}


def _perceptron(name: str, widths: list[int]) -> dict[str, tuple[int, ...]]:
    shapes: dict[str, tuple[int, ...]] = {}
    for layer, (given, made) in enumerate(itertools.pairwise(widths)):
        shapes[f"{name}.{layer}.weight"] = (made, given)
        shapes[f"{name}.{layer}.bias"] = (made,)
    return shapes


def _check_card(card: Any, name: str) -> None:
    """Raise a ``ValueError`` unless `card` is complete and of format `FORMAT`."""
    if isinstance(card, dict) and "variant" in card:
        raise ValueError(f"{name}: found weights of {card['variant']}, expected those of an agent")
    if not isinstance(card, dict) or not isinstance(card.get("format"), int):
        raise ValueError(f"{name}: found no card, expected that of an agent of format {FORMAT}")
    if card["format"] != FORMAT:
        raise ValueError(
            f"{name}: found format {card['format']}, of ruffini {card.get('ruffini', 'unknown')}, "
            f"expected format {FORMAT}"
        )
    missing = [key for key in Card.__annotations__ if key not in card]
    if missing:
        raise ValueError(f"{name}: found no {', '.join(missing)} in its card, expected all of it")


def _check_tensors(card: Card, tensors: dict[str, NDArray[Any]], name: str) -> None:
    """Raise a ``ValueError`` unless `tensors` are those of the card, and finite."""
    try:
        expected = shapes(card)
        known = card["network"]["activation"] in ACTIVATIONS
        whole = sorted(card["network"]["order"]) == sorted(card["channels"])
    except (AttributeError, IndexError, KeyError, TypeError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(f"{name}: its card is not that of an agent ({reason})") from None
    if not known or not whole:
        raise ValueError(
            f"{name}: found {card['network']}, expected each of {', '.join(card['channels'])}, "
            f"and an activation of {', '.join(ACTIVATIONS)}"
        )
    found = {key: values.shape for key, values in tensors.items()}
    for key in sorted(found.keys() | expected.keys()):
        if found.get(key) != expected.get(key):
            ours, theirs = (shape.get(key, "none") for shape in (found, expected))
            raise ValueError(f"{name}: {key}: found {ours}, expected {theirs}")
        if not np.isfinite(tensors[key]).all():
            raise ValueError(f"{name}: {key}: found numbers that are not finite")


def _check_shape(name: str, values: Floats, size: int) -> None:
    if values.ndim not in (1, 2) or values.shape[-1] != size:
        raise ValueError(f"{name}: found shape {values.shape}, expected ({size},) or (N, {size})")


def _listed(sizes: Mapping[str, int]) -> str:
    return ", ".join(f"{name} ({size})" for name, size in sorted(sizes.items()))
