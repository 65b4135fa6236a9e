"""A network that says where on a person each vertex of a shape lies.

Learned diffusion (Sharp et al., 2022, "DiffusionNet"): each block diffuses its channels
by heat for learned times, compares their gradients in the tangent plane, and mixes all
at each vertex. Gradients are compared with those turned by a right angle about the
outward normal too, so left and right differ.

The answer is a probability of each of some hundred anchors on the template, so a vertex
that may lie on either hand says so.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jfsf.types import ArrayLike

CHANNELS, BLOCKS = 96, 4
SLOPES = 0.05  # gradients of a shape of area 1 are some 20 times as large as values


class Shape(NamedTuple):
    """What the network reads of a shape; padding has mass 0.

    evals, mass, evecs: of its `Spectrum`.
    slopes: gradients of the eigenvectors, in a frame of the tangent plane of each
        vertex whose normal points outward.
    inputs: as `samples.inputs_of`.
    """

    evals: Float[ArrayLike, " k"]
    mass: Float[ArrayLike, " n"]
    evecs: Float[ArrayLike, "n k"]
    slopes: Float[ArrayLike, "n 2 k"]
    inputs: Float[ArrayLike, "n c"]


class Block(eqx.Module):
    """One round of diffusion."""

    log_times: Float[Array, " c"]
    real: Float[Array, "c c"]
    turned: Float[Array, "c c"]
    first: eqx.nn.Linear
    second: eqx.nn.Linear
    norm: eqx.nn.LayerNorm

    def __init__(self, channels: int, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, 5)
        self.log_times = jax.random.uniform(keys[0], (channels,), minval=-8, maxval=-1)
        scale = 1 / jnp.sqrt(channels)
        self.real = scale * jax.random.normal(keys[1], (channels, channels))
        self.turned = scale * jax.random.normal(keys[2], (channels, channels))
        self.first = eqx.nn.Linear(3 * channels, channels, key=keys[3])
        self.second = eqx.nn.Linear(channels, channels, key=keys[4])
        self.norm = eqx.nn.LayerNorm(channels)

    def __call__(self, x: Float[Array, "n c"], shape: Shape) -> Float[Array, "n c"]:
        own = jax.vmap(self.norm)(x)
        coefficients = shape.evecs.T @ (shape.mass[:, None] * own)
        times = jnp.exp(self.log_times)
        coefficients *= jnp.exp(-shape.evals[:, None] * times[None])
        spread = shape.evecs @ coefficients
        a, b = (SLOPES * shape.slopes[:, i] @ coefficients for i in range(2))
        real = a @ self.real - b @ self.turned
        turned = a @ self.turned + b @ self.real
        products = jnp.tanh(a * real + b * turned)
        mixed = jnp.concatenate([own, spread, products], 1)
        mixed = jax.nn.gelu(jax.vmap(self.first)(mixed))
        return x + jax.vmap(self.second)(mixed)


class Network(eqx.Module):
    """Logits of the anchors at each vertex."""

    enter: eqx.nn.Linear
    blocks: list[Block]
    norm: eqx.nn.LayerNorm
    leave: eqx.nn.Linear

    def __init__(self, inputs: int, anchors: int, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, BLOCKS + 2)
        self.enter = eqx.nn.Linear(inputs, CHANNELS, key=keys[0])
        self.blocks = [Block(CHANNELS, one) for one in keys[2:]]
        self.norm = eqx.nn.LayerNorm(CHANNELS)
        self.leave = eqx.nn.Linear(CHANNELS, anchors, key=keys[1])

    def __call__(self, shape: Shape) -> Float[Array, "n a"]:
        x = jax.vmap(self.enter)(shape.inputs)
        for block in self.blocks:
            x = block(x, shape)
        return jax.vmap(self.leave)(jax.vmap(self.norm)(x))
